"""The registers that a PLC writes and reads: names, addresses, types, units; conversion to 16-bit words.

The PLC writes the block from `WRITTEN_AT` on; the runtime writes the block from `READ_AT` on. Functions 3 and
4 read either. A value of two words has the high word first.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from runtime.plc.handshake import Error

WRITTEN_AT = 0
READ_AT = 100
UNKNOWN = 0xFFFF  # of one word: unknown, or too large for it
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


class Value(NamedTuple):
    """A register without its place in a block."""

    name: str
    type: str
    meaning: str
    scale: float = 1
    unit: str = ""


def _block(start: int, kind: str, *values: Value) -> tuple[Register, ...]:
    """Places values as consecutive registers from an address on."""
    registers: list[Register] = []
    for value in values:
        address = registers[-1].address + registers[-1].words if registers else start
        registers.append(Register(address=address, kind=kind, **value._asdict()))
    return tuple(registers)


WRITTEN = _block(
    WRITTEN_AT,
    "holding",
    Value(
        "enable",
        "bool",
        "triggers count; off and on clears error_id; reads 0 once enabling has ended",
    ),
    Value("trigger", "bool", "a rise begins a part"),
    Value("trigger_id", "uint16", "of the part that the next trigger begins"),
    Value("result_acknowledge", "bool", "a rise takes the result that waits"),
    Value("heartbeat_in", "uint16", "a counter or a toggle that changes at least once a second"),
    Value(
        "table", "uint16", "the table that the next trigger uses: its number among --tree, from 0"
    ),
)
READ = _block(
    READ_AT,
    "input",
    Value("acknowledge", "bool", "the trigger is accepted; falls with it"),
    Value("busy", "bool", "a part is under way"),
    Value("result_valid", "bool", "a result waits"),
    Value("result_id", "uint16", "trigger_id of the result"),
    Value("outcome", "uint16", ", ".join(f"{code} {name}" for code, name in enumerate(OUTCOMES))),
    Value(
        "error_id", "uint16", "why a trigger was refused or enabling ended, or the code of a fault"
    ),
    Value("heartbeat_out", "uint16", "a counter that changes four times a second"),
    Value("table_in_use", "uint16", "number of the table of the last accepted trigger"),
    Value("table_digest", "uint32", "first four bytes of the SHA-256 of that table's file"),
    Value(
        "x", "int32", "pose of the part in the world; 0 unless the outcome is located", 0.001, "mm"
    ),
    Value("y", "int32", "the same", 0.001, "mm"),
    Value("angle", "int32", "the same, counter-clockwise", 0.0001, "deg"),
    Value("part", "uint16", "which part it is, from 0 in the job's order"),
    Value("face", "uint16", "0 as drawn, 1 turned over"),
    Value(
        "expected_error",
        "uint16",
        "median error of the trials at this leaf; 65535 not known",
        0.001,
        "mm",
    ),
    Value("expected_error_p95", "uint16", "its 95th percentile; 65535 not known", 0.001, "mm"),
    Value("exit_code", "uint16", "of the part, as in runtime/OUTCOMES.md"),
    Value("parts_located", "uint32", "results of this outcome since the start, of all tables"),
    Value("parts_rejected", "uint32", "the same"),
    Value("parts_unresolved", "uint32", "the same"),
    Value("parts_fault", "uint32", "the same"),
    Value(
        "seconds_last",
        "uint16",
        "of the last part, from its first motion to its outcome; 65535 not known",
        0.01,
        "s",
    ),
    Value(
        "takt_share",
        "uint16",
        "parts done within --takt, of those with seconds; 65535 not known, or without --takt",
        0.01,
        "%",
    ),
)
MAP = WRITTEN + READ


def as_json() -> dict[str, object]:
    """The map for machines, as printed by `--plc-map json`; `values` explains codes."""
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
    """The consecutive words of registers."""
    together: list[int] = []
    for register in registers:
        value = values[register.name]
        together += (
            [value >> 16 & 0xFFFF, value & 0xFFFF] if register.words == 2 else [value & 0xFFFF]
        )
    return together
