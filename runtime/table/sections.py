"""The sections of a table's file; codec, validation and `TABLE.md` are all derived from this list."""

from collections.abc import Callable
from typing import Any, NamedTuple

from runtime.table import model
from runtime.table.fields import MAX_BRANCHES, MAX_LEAVES, MAX_NODES, Field, fields_of
from runtime.table.model import MAX_HYPOTHESES

MAX_PUSHES = 4
MAX_ALTERNATIVES = 32


class Section(NamedTuple):
    """A section of a table's file.

    It has a single record, or several, which the file stores as columns: one array for each field.
    """

    name: str
    meaning: str
    record: Callable[..., Any]
    row: str = ""  # what a record is called; empty: the section is a single record, without columns
    least: int = 1  # bounds of the number of records: of each owner, or in all
    most: int = 1
    # the column of owners: the index of the node or leaf that has the record
    owner: Field | None = None

    @property
    def optional(self) -> bool:
        """Whether a file omits the section when it has no records."""
        return self.name in OPTIONAL

    @property
    def fields(self) -> tuple[Field, ...]:
        """The fields of the section's record."""
        return FIELDS[self.name]

    @property
    def columns(self) -> tuple[Field, ...]:
        """The columns in the order of the file: the owner's index, if any, then the record's fields."""
        return self.fields if self.owner is None else (self.owner, *self.fields)


NODE = Field("number, never falling", 0, MAX_NODES - 1, name="node")
LEAF = Field("number, never falling", 0, MAX_LEAVES - 1, name="leaf")

SECTIONS = (
    Section("tool", "compiler", dict),
    Section("job_digest", "digest of the job", dict),
    Section("gripper", "gripper", model.GripperSpec),
    Section("goal", "when a part counts as located", model.GoalSpec),
    Section("limits", "what no motion may exceed", model.Limits),
    Section("predicted", "evaluation of the whole table", model.Prediction),
    Section("nodes", "squeezes", model.Squeeze, "node", 1, MAX_NODES),
    Section("branches", "outcomes of each squeeze", model.Branch, "branch", 1, MAX_BRANCHES, NODE),
    Section("leaves", "ends of the tree", model.Leaf, "leaf", 1, MAX_LEAVES),
    Section(
        "alternatives", "further poses", model.LeafPose, "alternative", 0, MAX_ALTERNATIVES, LEAF
    ),
    Section("hypotheses", "parts, if several", model.Hypothesis, "hypothesis", 2, MAX_HYPOTHESES),
    Section("releases", "where a held part is dragged", model.Place, "release", 0, 1, NODE),
    Section("pushes", "pushes before a squeeze, in order", model.Push, "push", 0, MAX_PUSHES, NODE),
    Section("contacts", "first contact of a squeeze, if known", dict, "contact", 0, 1, NODE),
    Section("job", "job, unless stripped", dict),
)
OPTIONAL = ("hypotheses", "releases", "pushes", "contacts", "job")
FIELDS: dict[str, tuple[Field, ...]] = {
    **{
        section.name: fields_of(section.record)
        for section in SECTIONS
        if section.record is not dict
    },
    **{name: fields_of(model.Table, name) for name in ("tool", "job_digest", "job")},
    "contacts": fields_of(model.Node, "contact_um"),
}


def records_of(table: model.Table) -> dict[str, list[tuple[int, Any]]]:
    """The records of a table by the name of their section, as pairs of an index and the record.

    The index is that of the node or leaf that owns the record; without an owner, that of the record.
    """
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
