"""The registers that a PLC writes and reads: names, addresses, types, units; and values as 16-bit words.

The PLC writes the block from `WRITTEN_AT` on; the runtime writes the block from `READ_AT` on. Functions 3 and
4 read either. A value of two words has the high word first.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from runtime.plc.handshake import Error

WRITTEN_AT = 0
READ_AT = 100
UNKNOWN = 0xFFFF  # of one word: it is not known, or too great for it
OUTCOMES = ("none", "located", "rejected", "unresolved", "fault")
HEARTBEAT_LIMIT_S = 3.0


class Register(NamedTuple):
    """One value of the map; its value in `unit` is the integer times `scale`."""

    name: str
    address: int
    kind: str  # "holding": written by the PLC; "input": written by the runtime
    type: str  # "bool", "uint16", "uint32" or "int32"
    scale: float
    unit: str
    meaning: str

    @property
    def words(self) -> int:
        """Number of 16-bit words."""
        return 2 if self.type.endswith("32") else 1

    @property
    def greatest(self) -> int:
        """Greatest integer that a PLC may write."""
        return 1 if self.type == "bool" else 0xFFFF


Entry = tuple[str, str, float, str, str]

_WRITTEN: tuple[Entry, ...] = (
    (
        "enable",
        "bool",
        1,
        "",
        "triggers count; off and on clears error_id; reads 0 once enabling has ended",
    ),
    ("trigger", "bool", 1, "", "a rise begins a part"),
    ("trigger_id", "uint16", 1, "", "of the part that the next trigger begins"),
    ("result_acknowledge", "bool", 1, "", "a rise takes the result that waits"),
    ("heartbeat_in", "uint16", 1, "", "a counter or a toggle that changes at least once a second"),
    (
        "table",
        "uint16",
        1,
        "",
        "the table that the next trigger uses: its number among --tree, from 0",
    ),
)

_READ: tuple[Entry, ...] = (
    ("acknowledge", "bool", 1, "", "the trigger is accepted; falls with it"),
    ("busy", "bool", 1, "", "a part is under way"),
    ("result_valid", "bool", 1, "", "a result waits"),
    ("result_id", "uint16", 1, "", "trigger_id of the result"),
    ("outcome", "uint16", 1, "", ", ".join(f"{code} {name}" for code, name in enumerate(OUTCOMES))),
    (
        "error_id",
        "uint16",
        1,
        "",
        "why a trigger was refused or enabling ended, or the code of a fault",
    ),
    ("heartbeat_out", "uint16", 1, "", "a counter that changes four times a second"),
    ("table_in_use", "uint16", 1, "", "number of the table of the last accepted trigger"),
    ("table_digest", "uint32", 1, "", "first four bytes of the SHA-256 of that table's file"),
    ("x", "int32", 0.001, "mm", "pose of the part in the world; 0 unless the outcome is located"),
    ("y", "int32", 0.001, "mm", "the same"),
    ("angle", "int32", 0.0001, "deg", "the same, counter-clockwise"),
    ("part", "uint16", 1, "", "which part it is, from 0 in the job's order"),
    ("face", "uint16", 1, "", "0 as drawn, 1 turned over"),
    (
        "expected_error",
        "uint16",
        0.001,
        "mm",
        "median error of the trials at this leaf; 65535 not known",
    ),
    ("expected_error_p95", "uint16", 0.001, "mm", "its 95th percentile; 65535 not known"),
    ("exit_code", "uint16", 1, "", "of the part, as in runtime/OUTCOMES.md"),
    ("parts_located", "uint32", 1, "", "results of this outcome since the start, of all tables"),
    ("parts_rejected", "uint32", 1, "", "the same"),
    ("parts_unresolved", "uint32", 1, "", "the same"),
    ("parts_fault", "uint32", 1, "", "the same"),
    (
        "seconds_last",
        "uint16",
        0.01,
        "s",
        "of the last part, from its first motion to its outcome; 65535 not known",
    ),
    (
        "takt_share",
        "uint16",
        0.01,
        "%",
        "parts done within --takt, of those with seconds; 65535 not known, or without --takt",
    ),
)


def _placed(entries: Sequence[Entry], start: int, kind: str) -> tuple[Register, ...]:
    registers: list[Register] = []
    for name, type_, scale, unit, meaning in entries:
        address = start if not registers else registers[-1].address + registers[-1].words
        registers.append(Register(name, address, kind, type_, scale, unit, meaning))
    return tuple(registers)


WRITTEN = _placed(_WRITTEN, WRITTEN_AT, "holding")
READ = _placed(_READ, READ_AT, "input")
MAP = WRITTEN + READ


def as_json() -> dict[str, object]:
    """The map for machines, as `--plc-map json` prints it; `values` says what codes mean."""
    errors = {str(error.value): error.name.lower().replace("_", " ") for error in Error}
    codes = {
        "outcome": {str(code): name for code, name in enumerate(OUTCOMES)},
        "error_id": errors,
    }
    registers = [
        {
            **register._asdict(),
            **({"values": codes[register.name]} if register.name in codes else {}),
        }
        for register in MAP
    ]
    return {"registers": registers, "heartbeat_limit_s": HEARTBEAT_LIMIT_S}


def words(registers: Sequence[Register], values: Mapping[str, int]) -> list[int]:
    """The words of registers, one after the other."""
    together: list[int] = []
    for register in registers:
        value = values[register.name]
        together += (
            [value >> 16 & 0xFFFF, value & 0xFFFF] if register.words == 2 else [value & 0xFFFF]
        )
    return together
