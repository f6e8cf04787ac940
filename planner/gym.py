"""A Gymnasium environment for localising a part by squeezing; `import planner.gym` registers it.

    env = gymnasium.make("SqueezeLocalize-v0")                        # the rectangle of the paper's Table I
    env = gymnasium.make("SqueezeLocalize-v0", job="job.toml", actions="box")
    many = gymnasium.make_vec("SqueezeLocalize-v0", num_envs=4096)    # a batch in one call of the kernels

An action either squeezes, for a reward of -1, or declares where the part lies. A declaration ends the
episode. Its reward is `Pomdp.success` if the declared pose is within the job's goal, else 0. An episode also
ends if an open finger comes down on the part. It is truncated at the first squeeze beyond `search.max_depth`.
The observation is the reading of the encoder, in steps of closing; it begins with 0.

With actions "set", an action is an index: first of the job's placements of the hand, then of candidate poses
to declare (`Pomdp.actions`). With "box", an action is four numbers from -1 to 1: x, y and theta of a pose,
and its use. A negative use squeezes at the pose, any other declares the pose. x and y span the region that
the part may cover before the first squeeze, within the work area; theta spans a full turn
(`Episodes.chosen`).

With `render_mode="rgb_array"`, `render()` draws the part, the fingers, and the belief that a particle filter
of `RENDERED` states infers from the readings.
"""

from importlib.resources import files
from typing import Any, Literal, get_args

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from planner import arguments
from planner.arrays import Array, BoolArray, IntArray
from planner.job.model import Job, load, parse
from planner.part.outline import reach
from planner.pomdp import DECLARE, SQUEEZE, Pomdp, declares
from planner.report.episode import pixels

try:
    import gymnasium
    from gymnasium import spaces
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError as missing:
    needed = f"planner.gym needs the gym extra ({missing.name} is missing)"
    raise ImportError(f"{needed}; install it with: pip install 'squeezetree[gym]'") from missing

NAME = "SqueezeLocalize-v0"
RENDERED = 2000  # states of the belief in a picture
RECTANGLE = files("planner").joinpath("templates/rectangle.toml").read_text("utf-8")

Kind = Literal["set", "box"]
Actions = NDArray[Any]
Info = dict[str, Any]
Source = Job | str | None  # a job, a job file, or None for the rectangle


def problem_of(job: Source, workers: int = 1) -> Pomdp:
    """Builds the POMDP of a job or a job file; None stands for the rectangle of the paper's Table I."""
    if job is None:
        job = parse(RECTANGLE, "the rectangle")
    return Pomdp.of_job(job if isinstance(job, Job) else load(job), workers)


class Episodes:
    """A batch of episodes of one problem."""

    def __init__(self, model: Pomdp, number: int, kind: Kind) -> None:
        if kind not in get_args(Kind):
            raise ValueError(f'actions are {kind!r}; write "set" or "box"')
        self.model = model
        self.states = np.zeros((arguments.count(number, "num_envs"), 4))
        self.squeezes = np.zeros(number, np.int64)
        # (2, 4) bounds of an action; None for a set.
        self.box = _box(model.job) if kind == "box" else None

    @property
    def action_space(self) -> spaces.Discrete | spaces.Box:
        """Action space of one episode."""
        if self.box is None:
            return spaces.Discrete(len(self.model.actions))
        return spaces.Box(-1.0, 1.0, (4,))

    def chosen(self, actions: Actions) -> Array:
        """Converts actions of the space, (n,) or (n, 4), to actions (n, 4) of the problem.

        Raises:
            ValueError: an action is not in the space.
        """
        if self.box is None:
            listed = self.model.actions
            return np.asarray(listed[arguments.indices(actions, "actions", len(listed))])
        actions = arguments.rows(actions, "actions", 4, least=-1.0, most=1.0)
        return np.asarray(self.box.mean(axis=0) + 0.5 * (self.box[1] - self.box[0]) * actions)

    def begin(self, rows: IntArray | BoolArray, rng: Generator) -> None:
        """Starts the episodes `rows` anew, each with a new part."""
        self.squeezes[rows] = 0
        self.states[rows] = self.model.initial(len(self.squeezes[rows]), rng)

    def step(
        self, rows: BoolArray, actions: Actions, rng: Generator
    ) -> tuple[IntArray, Array, BoolArray, BoolArray]:
        """Performs an action in each episode of the mask `rows` (n,); the others stay as they are.

        Returns:
            Observations, rewards, whether an episode has ended, and whether it is truncated; each (n,). In
            the other episodes they are 0 (open jaws), 0, False and False.
        """
        n = len(rows)
        counts, rewards = np.full(n, 0, np.int64), np.zeros(n)
        ended, cut = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        sampled = self.model.sample(self.states[rows], self.chosen(actions[rows]), rng)
        self.states[rows], counts[rows] = sampled.states, sampled.observations
        rewards[rows] = sampled.rewards
        self.squeezes[rows] += sampled.rewards < 0.0
        ended[rows] = sampled.ended
        cut[rows] = ~sampled.ended & (self.squeezes[rows] > self.model.job.search.max_depth)
        return counts, rewards, ended, cut


def _box(job: Job) -> Array:
    """Least and greatest action (2, 4): the region that the part may cover, any angle, both uses."""
    span = job.uncertainty.radius_mm + reach(job.part.outline_mm)
    low, high = np.clip(job.cell.work_area_mm, -span, span)
    return np.array([[*low, -np.pi, SQUEEZE], [*high, np.pi, DECLARE]])


class SqueezeLocalize(gymnasium.Env[np.int64, Any]):
    """Environment with one part at a time; `info` contains the true pose, which the agent should not use."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 2}  # noqa: RUF012

    def __init__(
        self,
        job: Source = None,
        actions: Kind = "set",
        render_mode: Literal["rgb_array"] | None = None,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f'render_mode is {render_mode!r}; write "rgb_array", or leave it out')
        self.render_mode = render_mode
        self._episodes = Episodes(problem_of(job), 1, actions)
        self.model = self._episodes.model
        self.observation_space = spaces.Discrete(self.model.encoder.steps + 1)
        self.action_space = self._episodes.action_space

    def reset(
        self, *, seed: int | None = None, options: Info | None = None
    ) -> tuple[np.int64, Info]:
        """Places a new part; `options` are not used."""
        super().reset(seed=seed, options=options)
        self._episodes.begin(np.ones(1, np.bool_), self.np_random)
        if self.render_mode:
            # A separate generator: an episode is the same with and without pictures.
            self._filter = np.random.default_rng(0)
            self._belief = self.model.initial(RENDERED, self._filter)
            self._last: Array | None = None
        return np.int64(0), self._info()

    def step(self, action: Any) -> tuple[np.int64, float, bool, bool, Info]:
        """Squeezes the part, or declares its pose and ends the episode."""
        one, actions = np.ones(1, np.bool_), np.asarray(action)[None]
        counts, rewards, ended, cut = self._episodes.step(one, actions, self.np_random)
        if self.render_mode:
            self._follow(self._episodes.chosen(actions)[0], int(counts[0]))
        return counts[0], float(rewards[0]), bool(ended[0]), bool(cut[0]), self._info()

    def render(self) -> Any:
        """Draws the part, the fingers and the belief; returns the picture, or None without `render_mode`."""
        if not self.render_mode:
            return None
        return pixels(self.model, self._episodes.states[0], self._belief, self._last)

    def _follow(self, action: Array, count: int) -> None:
        self._last = action
        if declares(action) or not len(self._belief):
            return
        try:
            self._belief = self.model.updated(self._belief, action, count, self._filter)
        except ValueError:  # no state explains the reading: no belief is drawn from now on
            self._belief = self._belief[:0]

    def _info(self) -> Info:
        return {"pose": self._episodes.states[0, :3].copy()}


class SqueezeLocalizeVector(VectorEnv[IntArray, Actions, NDArray[Any]]):
    """Many environments in one batch; an episode that has ended restarts at the next step (`NEXT_STEP`)."""

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self, num_envs: int = 1, job: Source = None, actions: Kind = "set", workers: int = 1
    ) -> None:
        self.num_envs = num_envs
        self._episodes = Episodes(problem_of(job, workers), num_envs, actions)
        self.model = self._episodes.model
        self._over = np.zeros(num_envs, np.bool_)
        self.single_observation_space = spaces.Discrete(self.model.encoder.steps + 1)
        self.single_action_space = self._episodes.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: Info | None = None
    ) -> tuple[IntArray, Info]:
        """Places all parts anew; `options` are not used."""
        super().reset(seed=seed, options=options)
        self._over[:] = False
        self._episodes.begin(~self._over, self.np_random)
        return np.full(self.num_envs, 0, np.int64), self._info()

    def step(self, actions: Actions) -> tuple[IntArray, Array, BoolArray, BoolArray, Info]:
        """Performs an action in each running episode, and restarts episodes that ended at the step before."""
        begun = self._over
        if begun.any():
            self._episodes.begin(begun, self.np_random)
        actions = np.asarray(actions)
        arguments.same_length(episodes=begun, actions=np.atleast_1d(actions))
        counts, rewards, ended, cut = self._episodes.step(~begun, actions, self.np_random)
        self._over = ended | cut
        return counts, rewards, ended, cut, self._info()

    def _info(self) -> Info:
        poses = self._episodes.states[:, :3].copy()
        return {"pose": poses, "_pose": np.ones(self.num_envs, np.bool_)}


gymnasium.register(
    NAME, "planner.gym:SqueezeLocalize", vector_entry_point="planner.gym:SqueezeLocalizeVector"
)
