"""The registers that a PLC writes and reads: their names, addresses, types and units.

The PLC writes the block that begins at address `WRITTEN_AT`. The runtime writes the block that begins at
`READ_AT`. The Modbus functions 3 and 4 each read both blocks. A value of two 16-bit words has the high word
first.
"""

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import NamedTuple

from runtime.plc.handshake import Error

WRITTEN_AT = 0
READ_AT = 100
UNKNOWN = 0xFFFF  # value of a one-word register for a quantity that is unknown or too large
OUTCOMES = ("none", "located", "rejected", "unresolved", "fault")
HEARTBEAT_LIMIT_S = 3.0


class Register(NamedTuple):
    """A named value of the register map: an integer of one or two words.

    The integer times `scale` is the quantity in `unit`.
    """

    name: str
    type: str  # "bool", "uint16", "uint32" or "int32"
    meaning: str
    scale: float = 1
    unit: str = ""
    address: int = 0
    kind: str = ""  # "holding": written by the PLC; "input": written by the runtime

    @property
    def words(self) -> int:
        """Number of 16-bit words of the register."""
        return 2 if self.type.endswith("32") else 1

    @property
    def greatest(self) -> int:
        """Greatest integer that a PLC may write to the register."""
        return 1 if self.type == "bool" else 0xFFFF


def _block(address: int, kind: str, *registers: Register) -> tuple[Register, ...]:
    """Returns registers with their kind, and with consecutive addresses, the first at `address`."""
    ends = accumulate((register.words for register in registers), initial=address)
    pairs = zip(registers, ends, strict=False)
    return tuple(register._replace(address=at, kind=kind) for register, at in pairs)


WRITTEN = _block(
    WRITTEN_AT,
    "holding",
    Register(
        "enable",
        "bool",
        "triggers count; off and on clears error_id; reads 0 once enabling has ended",
    ),
    Register("trigger", "bool", "a rise begins a part"),
    Register("trigger_id", "uint16", "of the part that the next trigger begins"),
    Register("result_acknowledge", "bool", "a rise takes the result that waits"),
    Register("heartbeat_in", "uint16", "a counter or a toggle that changes at least once a second"),
    Register(
        "table", "uint16", "the table that the next trigger uses: its number among --tree, from 0"
    ),
)
READ = _block(
    READ_AT,
    "input",
    Register("acknowledge", "bool", "the trigger is accepted; falls with it"),
    Register("busy", "bool", "a part is under way"),
    Register("result_valid", "bool", "a result waits"),
    Register("result_id", "uint16", "trigger_id of the result"),
    Register(
        "outcome", "uint16", ", ".join(f"{code} {name}" for code, name in enumerate(OUTCOMES))
    ),
    Register(
        "error_id", "uint16", "why a trigger was refused or enabling ended, or the code of a fault"
    ),
    Register("heartbeat_out", "uint16", "a counter that changes four times a second"),
    Register("table_in_use", "uint16", "number of the table of the last accepted trigger"),
    Register("table_digest", "uint32", "first four bytes of the SHA-256 of that table's file"),
    Register(
        "x", "int32", "pose of the part in the world; 0 unless the outcome is located", 0.001, "mm"
    ),
    Register("y", "int32", "the same", 0.001, "mm"),
    Register("angle", "int32", "the same, counter-clockwise", 0.0001, "deg"),
    Register("part", "uint16", "which part it is, from 0 in the job's order"),
    Register("face", "uint16", "0 as drawn, 1 turned over"),
    Register(
        "expected_error",
        "uint16",
        "median error of the trials at this leaf; 65535 not known",
        0.001,
        "mm",
    ),
    Register("expected_error_p95", "uint16", "its 95th percentile; 65535 not known", 0.001, "mm"),
    Register("exit_code", "uint16", "of the part, as in runtime/OUTCOMES.md"),
    Register("parts_located", "uint32", "results of this outcome since the start, of all tables"),
    Register("parts_rejected", "uint32", "the same"),
    Register("parts_unresolved", "uint32", "the same"),
    Register("parts_fault", "uint32", "the same"),
    Register(
        "seconds_last",
        "uint16",
        "of the last part, from its first motion to its outcome, delivery included; 65535 not known",
        0.01,
        "s",
    ),
    Register(
        "takt_share",
        "uint16",
        "parts done within --takt, of those with seconds; 65535 not known, or without --takt",
        0.01,
        "%",
    ),
)
MAP = WRITTEN + READ


def as_json() -> dict[str, object]:
    """The register map in the form of JSON, as `--plc-map json` prints it.

    The entries of `outcome` and `error_id` have a field `values`, with the meaning of each code.
    """
    errors = {str(error.value): error.name.lower().replace("_", " ") for error in Error}
    outcomes = {str(code): name for code, name in enumerate(OUTCOMES)}
    registers = {register.name: register._asdict() for register in MAP}
    registers["outcome"]["values"] = outcomes
    registers["error_id"]["values"] = errors
    return {"registers": [*registers.values()], "heartbeat_limit_s": HEARTBEAT_LIMIT_S}


def words(registers: Sequence[Register], values: Mapping[str, int]) -> list[int]:
    """Converts the values of consecutive registers to 16-bit words.

    Args:
        registers: the registers, in order.
        values: integers by register name.
    """
    together: list[int] = []
    for register in registers:
        value = values[register.name]
        together += [value >> 16 & 0xFFFF, value & 0xFFFF][-register.words :]
    return together
