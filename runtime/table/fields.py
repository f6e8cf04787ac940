"""The sections of a table's file and their fields: the common source of codec, validation and `TABLE.md`.

A bound given as text is the name of a value of the table, `limits.max_depth` for instance.
"""

from collections.abc import Callable
from operator import attrgetter
from typing import Any, NamedTuple

from runtime.shell.plain_text import LONGEST
from runtime.table.model import (
    PPM,
    Branch,
    GoalSpec,
    GripperSpec,
    Hypothesis,
    Leaf,
    LeafPose,
    Limits,
    Place,
    Prediction,
    Push,
    Squeeze,
    Table,
)

MAX_NODES = 1 << 12
MAX_LEAVES = 1 << 14
MAX_BRANCHES = 32
MAX_PUSHES = 4
MAX_ALTERNATIVES = 32
MAX_DEPTH = 64
MAX_HYPOTHESES = 16
MAX_ANGLE_URAD = 3_142_000
MAX_TRIALS = 10**10
MAX_BYTES = 2 << 20  # of a file
FAR = 10**9
WIDE = 1_000_000

FLAG = "flag"  # 0 or 1, a bool in the records
LINE = "line"  # printable characters
TEXT = "text"
TYPES: dict[str, type] = {"int": int, FLAG: int, LINE: str, TEXT: str, "bytes": bytes}


class Field(NamedTuple):
    """One value of a record: the attribute's name, dotted for nested records, and its meaning."""

    name: str
    meaning: str
    least: int | str = 0  # bounds of an int, or of the length of other types
    most: int | str = FAR
    type: str = "int"  # one of `TYPES`

    def bounds(self, table: Table) -> tuple[int, int]:
        """The least and the greatest value or length in a table."""
        least, most = (
            bound if isinstance(bound, int) else attrgetter(bound)(table)
            for bound in (self.least, self.most)
        )
        return least, most


class Section(NamedTuple):
    """One record, or columns of records: one array for each field."""

    name: str
    meaning: str
    record: Callable[..., Any]
    row: str = ""  # name of a record; empty: a single record, without columns
    least: int = 1  # number of records, or for each owner
    most: int = 1
    owner: Field | None = None  # the column with the index of a record's node or leaf

    @property
    def optional(self) -> bool:
        """Whether the section may be absent, without records."""
        return self.name in OPTIONAL

    @property
    def fields(self) -> tuple[Field, ...]:
        """The fields of its record."""
        return FIELDS[self.name]

    @property
    def columns(self) -> tuple[Field, ...]:
        """All fields in the order of the file."""
        return self.fields if self.owner is None else (self.owner, *self.fields)


X = ("limits.work_area_um.x_min", "limits.work_area_um.x_max")
Y = ("limits.work_area_um.y_min", "limits.work_area_um.y_max")
TURN = (-MAX_ANGLE_URAD, MAX_ANGLE_URAD)
WIDTH = (0, "gripper.opening_um")
NODE = Field("node", "number, never falling", 0, MAX_NODES - 1)
LEAF = Field("leaf", "number, never falling", 0, MAX_LEAVES - 1)

SECTIONS = (
    Section("tool", "compiler", dict),
    Section("job_digest", "digest of the job", dict),
    Section("gripper", "gripper", GripperSpec),
    Section("goal", "when a part counts as located", GoalSpec),
    Section("limits", "what no motion may exceed", Limits),
    Section("predicted", "evaluation of the whole table", Prediction),
    Section("nodes", "squeezes", Squeeze, "node", 1, MAX_NODES),
    Section("branches", "outcomes of each squeeze", Branch, "branch", 1, MAX_BRANCHES, NODE),
    Section("leaves", "ends of the tree", Leaf, "leaf", 1, MAX_LEAVES),
    Section("alternatives", "further poses", LeafPose, "alternative", 0, MAX_ALTERNATIVES, LEAF),
    Section("hypotheses", "parts, if several", Hypothesis, "hypothesis", 2, MAX_HYPOTHESES),
    Section("releases", "where a held part is dragged", Place, "release", 0, 1, NODE),
    Section("pushes", "pushes before a squeeze, in order", Push, "push", 0, MAX_PUSHES, NODE),
    Section("contacts", "first contact of a squeeze, if known", dict, "contact", 0, 1, NODE),
    Section("job", "job, unless stripped", dict),
)
OPTIONAL = ("hypotheses", "releases", "pushes", "contacts", "job")
FIELDS: dict[str, tuple[Field, ...]] = {
    "tool": (Field("tool", "name and version", 1, LONGEST, LINE),),
    "job_digest": (Field("job_digest", "SHA-256 of the job's text", 32, 32, "bytes"),),
    "gripper": (
        Field("model", "name of the model", 1, LONGEST, LINE),
        Field("opening_um", "widest opening", 1, WIDE),
        Field("finger_length_um", "along x", 1, WIDE),
        Field("finger_width_um", "along y", 1, WIDE),
        Field("steps", "of a reading from 0 to the opening", 1, WIDE),
        Field("noise_um", "of a reading, standard deviation", *WIDTH),
        Field("empty_um", "up to it the object flag may miss a part", *WIDTH),
        Field("least_speed_um_s", "of closing"),
        Field("most_speed_um_s", "the same", "gripper.least_speed_um_s"),
        Field("least_force_mn", "of closing"),
        Field("most_force_mn", "the same", "gripper.least_force_mn"),
        Field("streams", "1: takes another stroke on its way", 0, 1, FLAG),
    ),
    "goal": (
        Field("distance_um", "bound of the error"),
        Field("confidence_ppm", "share of parts to locate", 0, PPM),
        Field("rho_um", "weight of one radian"),
        Field("symmetry", "rotational order, 1: none", 1, 1000),
        Field("kind", "see below", 1, LONGEST, LINE),
        Field("tolerance.x_um", "bound of abs(dx)"),
        Field("tolerance.y_um", "bound of abs(dy)"),
        Field("tolerance.theta_urad", "bound of abs(dtheta)"),
        Field("modes", "poses that a leaf may name", 1, 64),
        Field("identify", "1: leaves must name the right part", 0, 1, FLAG),
    ),
    "limits": (
        Field("max_depth", "squeezes to any leaf", 1, MAX_DEPTH),
        Field("max_force_mn", "closing force", 1),
        Field("max_speed_um_s", "closing speed", 1),
        Field("work_area_um.x_min", "of hand's centre and located parts", -FAR),
        Field("work_area_um.y_min", "the same", -FAR),
        Field("work_area_um.x_max", "the same", "limits.work_area_um.x_min"),
        Field("work_area_um.y_max", "the same", "limits.work_area_um.y_min"),
        Field("retreat_height_um", "of travelling tips", -FAR),
        Field("squeeze_height_um", "of squeezing tips, below the former", -FAR),
        Field("arm_speed_um_s", "speed of the arm", 1),
    ),
    "predicted": (
        Field("success_ppm", "trials that met the goal", 0, PPM),
        Field("trials", "0: not evaluated", 0, MAX_TRIALS),
        Field("mean_squeezes_ppm", "squeezes a part, millionths", 0, MAX_DEPTH * PPM),
        Field("reject_ppm", "trials that ended in REJECT", 0, PPM),
        Field("error_median_um", "at resolved leaves", 0, "predicted.error_p95_um"),
        Field("error_p95_um", "95th percentile"),
    ),
    "nodes": (
        Field("x_um", "hand's centre", *X),
        Field("y_um", "hand's centre", *Y),
        Field("angle_urad", "of the hand", *TURN),
        Field("opening_um", "before the squeeze", 1, "gripper.opening_um"),
        Field("speed_um_s", "of closing", 1, "limits.max_speed_um_s"),
        Field("force_mn", "of closing", 1, "limits.max_force_mn"),
        Field("clearance_um", "open fingers to any believed pose", 0, WIDE),
    ),
    "branches": (
        Field("low_um", "least width", *WIDTH),
        Field("expected_um", "expected width", *WIDTH),
        Field("high_um", "greatest width", *WIDTH),
        Field("probability_ppm", "share of the node's outcomes", 0, PPM),
        Field("target", ">= 0: node, < 0: leaf ~target", -MAX_LEAVES, MAX_NODES - 1),
    ),
    "leaves": (
        Field("x_um", "predicted pose", -FAR),
        Field("y_um", "predicted pose", -FAR),
        Field("theta_urad", "predicted pose", *TURN),
        Field("covariance.xx", "in 0.1 mm and 10 mrad"),
        Field("covariance.xy", "the same", -FAR),
        Field("covariance.yy", "the same"),
        Field("covariance.xt", "the same", -FAR),
        Field("covariance.yt", "the same", -FAR),
        Field("covariance.tt", "the same"),
        Field("success_ppm", "trials here that met the goal", 0, PPM),
        Field("trials", "0: success not known", 0, MAX_TRIALS),
        Field("resolved", "0: the outcome is UNRESOLVED", 0, 1, FLAG),
        Field("error_median_um", "of these trials"),
        Field("error_p95_um", "95th percentile"),
        Field("hypothesis", "number of the part", 0, MAX_HYPOTHESES - 1),
    ),
    "alternatives": (
        Field("x_um", "pose", -FAR),
        Field("y_um", "pose", -FAR),
        Field("theta_urad", "pose", *TURN),
        Field("hypothesis", "number of the part", 0, MAX_HYPOTHESES - 1),
    ),
    "hypotheses": (
        Field("name", "of the part", 1, LONGEST, LINE),
        Field("share_ppm", "of the parts that come", 0, PPM),
        Field("rho_um", "as in `goal`"),
        Field("symmetry", "as in `goal`", 1, 1000),
    ),
    "releases": (
        Field("x_um", "hand's centre", *X),
        Field("y_um", "hand's centre", *Y),
    ),
    "pushes": (
        Field("x_um", "hand's centre at the start", *X),
        Field("y_um", "the same", *Y),
        Field("angle_urad", "of hand and way", *TURN),
        Field("opening_um", "of the jaws", *WIDTH),
        Field("length_um", "of the way", 1, WIDE),
        Field("speed_um_s", "of the hand", 1, "limits.arm_speed_um_s"),
    ),
    "contacts": (Field("contact_um", "greatest width of a contact", *WIDTH),),
    "job": (Field("job", "canonical text, a JSON object", 0, MAX_BYTES, TEXT),),
}


def records_of(table: Table) -> dict[str, list[tuple[int, Any]]]:
    """The records of each section, each with the index of its owner, or its own index without one."""
    nodes, leaves = list(enumerate(table.nodes)), list(enumerate(table.leaves))
    return {
        "tool": [(0, table)],
        "job_digest": [(0, table)],
        "gripper": [(0, table.gripper)],
        "goal": [(0, table.goal)],
        "limits": [(0, table.limits)],
        "predicted": [(0, table.predicted)],
        "nodes": [(at, node.squeeze) for at, node in nodes],
        "branches": [(at, branch) for at, node in nodes for branch in node.branches],
        "leaves": leaves,
        "alternatives": [(at, pose) for at, leaf in leaves for pose in leaf.alternatives],
        "hypotheses": list(enumerate(table.hypotheses)),
        "releases": [(at, node.release) for at, node in nodes if node.release is not None],
        "pushes": [(at, push) for at, node in nodes for push in node.pushes],
        "contacts": [(at, node) for at, node in nodes if node.contact_um is not None],
        "job": [] if table.job is None else [(0, table)],
    }
