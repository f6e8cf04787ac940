"""Driver of an ABB arm on an OmniCore controller, over Robot Web Services 2.

It was never tried on a controller. The RAPID module `SqueezeTree.modx` on the controller executes the
requests. Connecting only reads. The first motion sets the program pointer to that module, reads the pointer
back, and starts the program. An interrupted or late motion is stopped.
"""

import math
import secrets

from drivers.abb import codec
from drivers.abb.codec import Pose, ProtocolError
from drivers.abb.reach import Setup, setup_of, within_sphere
from drivers.abb.rws import Rws, RwsError, State
from drivers.abb.upright import Motion, UprightArm
from drivers.clock import Pace
from drivers.errors import ArmError, shown
from drivers.stream import closed_on_error, open_tcp, tcp_address

TASK, MODULE, ROUTINE, UNIT = "T_ROB1", "SqueezeTree", "SqueezeTreeMain", "ROB_1"
EXECUTION = "/rw/rapid/execution"
MECHANICS = f"/rw/motionsystem/mechunits/{UNIT}"
VERSION = "1"
SYMBOL = f"/rw/rapid/symbol/RAPID/{TASK}/{MODULE}"
POINTER = f"/rw/rapid/tasks/{TASK}/pcp"
START = {
    "regain": "continue",
    "execmode": "continue",
    "cycle": "once",
    "condition": "none",
    "stopatbp": "disabled",
    "alltaskbytsp": "false",
}
STOP = {"stopmode": "stop", "usetsp": "normal"}
PORT = 443
# longest time from a request, or from the start of the program, to the first response
START_S = 3.0
LOOK_S = 0.1  # time between two polls: the controller serves some twenty requests a second
MOST_NUMBER = 8_000_000  # a RAPID num counts exactly up to here
HINT = "check the address, and that Robot Web Services are reachable from this network"


class Arm(UprightArm):
    """Driver of an OmniCore arm over an open session, which this object owns; `connect` creates both.

    After `close`, the RAPID program on the controller keeps waiting for requests.

    Raises:
        ArmError: the other side is no OmniCore controller, or lacks the RAPID module.
    """

    _link: Rws

    def __init__(self, rws: Rws, endpoint: str, pace: Pace, setup: Setup) -> None:
        super().__init__(endpoint, rws, pace, setup, within_sphere(setup))
        # Number of the last request; starts at random, not to repeat the numbers of an earlier client.
        self._moves = secrets.randbelow(MOST_NUMBER)
        try:
            version = self._symbol("sq_version")
        except ArmError as error:
            remedy = f"load {MODULE}.modx into {TASK} (tools/docs/arms.md)"
            raise ArmError(f"{error}; {remedy}") from error
        if version != VERSION:
            raise ArmError(
                f"arm at {endpoint} has {MODULE}.modx of version {shown(version)}; load version {VERSION}"
            )

    def _read_hand(self) -> Pose:
        seen = self._look(f"{MECHANICS}/cartesian", tool="tool0", wobj="wobj0", coordinate="Base")
        x, y, z, *turn = _numbers(seen, "x", "y", "z", "q1", "q2", "q3", "q4")
        length = math.hypot(*turn)
        if abs(length - 1.0) > 0.01:
            raise ProtocolError(f"a quaternion of length {length:.3f}")
        q1, q2, q3, q4 = (part / length for part in turn)
        return self._setup.hand_at(Pose(x, y, z, (q1, q2, q3, q4)))

    def _read_last_axis(self) -> float:
        return math.radians(_numbers(self._look(f"{MECHANICS}/jointtarget"), "rax_6")[0])

    def _drive(self, motion: Motion) -> None:
        if reason := self._objection():
            raise ArmError(f"arm at {self.endpoint} not moved: {reason}")
        with self._stopped_on_error(lambda: self._link.post(f"{EXECUTION}/stop", STOP)):
            if not self._runs():
                self._start()
            self._write("sq_tframe", _rapid(self._setup.tool))
            self._write("sq_oframe", _rapid(self._setup.work_object))
            self._write("sq_target", _rapid(motion.target.frame))
            speed, turn = codec.speed_numbers(motion.speed_mm_s, motion.turn_rad_s)
            self._write("sq_speed", speed)
            self._write("sq_turn", turn)
            self._next()
            self._await("sq_started", START_S, "it did not begin a motion; see which program runs")
            self._await("sq_done", motion.budget_s, f"not there after {motion.budget_s:.1f} s")

    def _objection(self) -> str:
        """Returns why the arm may not be moved; empty if it may."""
        mode = str(self._look("/rw/panel/opmode").get("opmode", "unknown"))
        motors = str(self._look("/rw/panel/ctrl-state").get("ctrlstate", "unknown"))
        if mode.upper() != "AUTO":
            return f"the controller is in mode {shown(mode)}; switch it to automatic"
        if motors != "motoron":
            return f"the controller is in state {shown(motors)}; put it right, with motors on"
        if self._runs() and (module := self._pointer()[0]) not in (None, MODULE):
            return f"module {shown(module)} runs on the controller; stop it first"
        return ""

    def _pointer(self) -> tuple[str | None, str | None]:
        """Reads the module and the routine at the program pointer; None for each that is unknown."""
        states = self._states(POINTER)
        line = next((state for state in states if state.get("_title") == "progpointer"), {})
        # RWS spells the name `modulemame`.
        return line.get("modulemame") or line.get("modulename"), line.get("routinename")

    def _runs(self) -> bool:
        return self._look(EXECUTION).get("ctrlexecstate") == "running"

    def _start(self) -> None:
        """Starts the program at the module, and waits until the program runs; nothing moves yet."""
        self._link.post("/rw/mastership/edit/request", {})
        try:
            where = {"module": MODULE, "routine": ROUTINE, "userlevel": "FALSE"}
            self._link.post(f"{POINTER}/routine", where)
        finally:
            self._link.post("/rw/mastership/edit/release", {})
        if self._pointer() != (MODULE, ROUTINE):
            raise self._lose(
                "the program pointer could not be set to our module; start it on the pendant"
            )
        # At its start, the program reports any request as done without a motion: a sign that it runs.
        self._next()
        self._link.post(f"{EXECUTION}/start", START, mastership="implicit")
        for _ in self._pace.polls(self._pace.deadline(START_S), LOOK_S):
            if _is(self._symbol("sq_done"), self._moves):
                return
        raise self._lose("the program did not start")

    def _next(self) -> None:
        self._moves = self._moves % MOST_NUMBER + 1
        self._write("sq_request", str(self._moves))

    def _await(self, name: str, budget_s: float, otherwise: str) -> None:
        for _ in self._pace.polls(self._pace.deadline(budget_s), LOOK_S):
            runs = self._runs()  # read first: a program may end after it reported the number
            if _is(self._symbol(name), self._moves):
                return
            if not runs:
                raise self._lose("its program stopped on the way; see the event log")
        raise self._lose(otherwise)

    def _symbol(self, name: str) -> str:
        return str(self._look(f"{SYMBOL}/{name}/data").get("value"))

    def _write(self, name: str, value: str) -> None:
        self._link.post(f"{SYMBOL}/{name}/data", {"value": value}, mastership="implicit")

    def _look(self, path: str, **query: str) -> State:
        return self._states(path, **query)[0]

    def _states(self, path: str, **query: str) -> list[State]:
        self._check_known()
        try:
            return self._link.state(path, **query)
        except RwsError as error:
            raise self._lose(str(error)) from error


def _numbers(seen: State, *names: str) -> tuple[float, ...]:
    try:
        values = tuple(float(seen[name]) for name in names)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ProtocolError(f"no numbers {', '.join(names)} in the answer") from error
    if not all(map(math.isfinite, values)):
        raise ProtocolError(f"numbers that are not finite: {values}")
    return values


def _is(text: str, number: int) -> bool:
    try:
        return float(text) == number
    except ValueError:
        return False


def _rapid(pose: Pose) -> str:
    """Returns a pose in RAPID syntax."""
    x, y, z, *turn = codec.pose_numbers(pose)
    return f"[[{x},{y},{z}],[{','.join(turn)}]]"


def connect(url: str, pace: Pace, *, read_only: bool) -> Arm:
    """Connects to a controller; only reads, and moves nothing.

    Raises:
        PortError: the connection is refused, or the address is invalid.
        ArmError: the other side is not an OmniCore controller, or lacks the module.
    """
    setup = setup_of(url, read_only=read_only)
    host, port = tcp_address(url.partition("?")[0], PORT)
    endpoint = f"omnicore://{host}:{port}"
    open_tcp(host, port, endpoint, HINT).close()
    rws = Rws(host, port, pace, read_only=read_only)
    with closed_on_error(rws):
        return Arm(rws, endpoint, pace, setup)
