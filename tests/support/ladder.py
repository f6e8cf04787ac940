"""An interpreter of ladder diagrams in text: executes rungs from top to bottom, each from left to right."""

import re

ELEMENT = re.compile(
    r"\[(?P<closed>/?) (?P<contact>\w+)(?: (?P<sign>[=>]) (?P<with>\w+))? \]"
    r"|\((?P<kind>[SR]?) (?P<coil>\w+) \)"
    r"|\{ (?P<source>\w+) -> (?P<target>\w+) \}"
)


class Ladder:
    """A ladder diagram and its variables, which are 0 at first; each call executes one cycle."""

    def __init__(self, text: str) -> None:
        lines = [line for line in text.splitlines() if line.startswith("|")]
        assert all(not ELEMENT.sub("", line).strip("|-") for line in lines)
        self._rungs = [list(ELEMENT.finditer(line)) for line in lines]
        self._memory: dict[str, int] = {}

    def __call__(self, **inputs: int) -> dict[str, int]:
        """Sets the inputs, executes a cycle, and returns a copy of all variables."""
        self._memory.update(inputs)
        for rung in self._rungs:
            power = True
            for element in rung:
                power = self._step(element, power=power)
        return dict(self._memory)

    def _step(self, element: re.Match[str], *, power: bool) -> bool:
        part = element.groupdict()
        if part["contact"]:
            value, other = self._value(part["contact"]), self._value(part["with"] or "0")
            holds = value == other if part["sign"] == "=" else value > other
            return power and holds != bool(part["closed"])
        if part["coil"] and (power or not part["kind"]):
            self._memory[part["coil"]] = int(power and part["kind"] != "R")
        if part["target"] and power:
            self._memory[part["target"]] = self._value(part["source"])
        return power

    def _value(self, name: str) -> int:
        return int(name) if name.isdigit() else self._memory.get(name, 0)
