"""Simulates handshakes of a PLC in virtual time; exchanges are dropped, doubled, late or reordered.

The PLC writes and reads without waiting for answers. As on one connection of Modbus TCP, writes are executed
in the order in which they were sent. An answer is discarded if, by its transaction number, it is older than
an answer that was read before. Now and then the connection breaks, the PLC stands still, loses its power,
triggers twice, or leaves its acknowledge up.
"""

from collections import Counter, deque
from dataclasses import dataclass, field
from random import Random

from runtime.plc.handshake import SIGNALS, State
from runtime.plc.registers import HEARTBEAT_LIMIT_S, READ, READ_AT, WRITTEN, WRITTEN_AT
from runtime.plc.station import Answer, Station

CYCLE_S = 0.05
MOST_PART_S = 0.3  # longest time of a part
MOST_UNDER_WAY = 6  # most exchanges that are sent and not yet executed
PATIENCE = 20  # cycles without an effect after which the acknowledge is toggled
_OFFSET = {register.name: register.address - READ_AT for register in READ}
_LENGTH = READ[-1].address + READ[-1].words - READ_AT


@dataclass(frozen=True)
class Faults:
    """Probabilities of faults: the first three per exchange, `lazy` per part, the others per cycle."""

    dropped: float = 0.1
    doubled: float = 0.1
    late: float = 0.3
    broken: float = 0.002
    stands_still: float = 0.001
    power: float = 0.001
    double_trigger: float = 0.02
    lazy: float = 0.2  # the acknowledge of a part stays up until the next part is under way


@dataclass
class Program:
    """The program of the PLC: tools/docs/clients/plc.st in Python, which triggers part after part."""

    lazy: bool = False
    state: int = 0
    enable: bool = False
    trigger: bool = False
    trigger_id: int = 0
    acknowledge: bool = False
    heartbeat: int = 0
    cycles: int = 0  # cycles since the acknowledge
    taken: list[tuple[int, int]] = field(default_factory=list)  # retentive: id and x of each result

    def cycle(self, words: list[int], next_id: int) -> None:
        """Executes one cycle with the registers read last; `next_id` is the id of the next part."""
        acknowledged, busy, valid, valid_id = words[:4]
        error = words[_OFFSET["error_id"]]
        self.heartbeat = (self.heartbeat + 1) & 0xFFFF
        self.enable = True
        if self.state == 0:
            self.trigger_id, self.trigger, self.state = next_id, True, 1
        elif self.state == 1:
            if acknowledged or busy or valid:
                self.trigger, self.state = False, 2
            elif error:
                self.trigger, self.enable, self.state = False, False, 5
        elif self.state == 2:
            if self.lazy and busy:
                self.acknowledge = False
            if valid and valid_id == self.trigger_id and not self.acknowledge:
                self._take(words)
                self.acknowledge, self.state, self.cycles = True, 3, 0
            elif valid and self.acknowledge:  # left up from the part before; takes no result
                self.acknowledge = False
            elif not (acknowledged or busy or valid):  # the runtime was started again
                self.enable, self.state = False, 5
        elif self.state == 3:
            self.cycles += 1
            if not valid:
                self.acknowledge, self.state = self.lazy, 4
            elif self.cycles % PATIENCE == 0:  # an edge of the acknowledge was lost
                self.acknowledge = not self.acknowledge
        elif self.state == 4:
            if (self.lazy or valid_id == 0) and not acknowledged:
                self.state = 0
        elif self.state == 5:
            self.state = 6
        elif error:
            self.enable, self.state = False, 5
        else:
            self.state = 0

    def restart(self) -> None:
        """Starts the program after a loss of power: its signals are dropped, and it awaits a result."""
        self.state, self.enable, self.trigger, self.acknowledge = 2, False, False, False

    def image(self) -> list[int]:
        """The values that the PLC writes, in the order of the registers."""
        return [self.enable, self.trigger, self.trigger_id, self.acknowledge, self.heartbeat, 0]

    def _take(self, words: list[int]) -> None:
        x = words[_OFFSET["x"]] << 16 | words[_OFFSET["x"] + 1]
        if not self.taken or self.taken[-1] != (self.trigger_id, x):
            self.taken.append((self.trigger_id, x))


class Study:
    """Handshakes of one PLC with one station.

    Attributes:
        given: id and x coordinate of each result that the runtime returned; x is random, to identify it.
        counts: number of each kind of fault, and of each value of `error_id`.
    """

    def __init__(self, seed: int, faults: Faults | None = None) -> None:
        self._random, self._faults = Random(seed), faults or Faults()
        self.station, self.program = Station([0]), Program()
        self.given: list[tuple[int, int]] = []
        self.counts: Counter[str] = Counter()
        self._now, self._ends_s = 0.0, 0.0
        self._writes: deque[list[int]] = deque()
        self._answers: deque[tuple[int, list[int]]] = deque()
        self._number = self._newest = 0
        self._seen = [0] * _LENGTH

    def run(self, parts: int) -> None:
        """Runs until the PLC has taken `parts` results."""
        while len(self.program.taken) < parts:
            self.step()

    def check(self) -> None:
        """Asserts that no result was lost, taken twice, or taken for another part."""
        given, taken = self.given, self.program.taken
        assert taken == given[: len(taken)]
        assert len(given) - len(taken) <= 1
        assert len(set(taken)) == len(taken)

    def _hits(self, name: str) -> bool:
        hit = self._random.random() < getattr(self._faults, name)
        self.counts[name] += hit
        return hit

    def step(self) -> None:
        """Simulates one cycle of the PLC, and the runtime during the cycle."""
        self._now += CYCLE_S
        program = self.program
        if program.state == 0:
            program.lazy = self._hits("lazy")
        program.cycle(self._seen, len(program.taken) % 0xFFFF + 1)
        self._send(program.image())
        if program.state == 2 and self._hits("double_trigger"):
            other = self._random.randrange(0x10000)
            self._send([1, 1, other, program.acknowledge, program.heartbeat, 0])
            self._send(program.image())
        self._execute()
        self._runtime()
        self._read()
        self._interrupt()

    def _send(self, image: list[int]) -> None:
        if not self._hits("dropped"):
            self._writes.extend([image] * (1 + self._hits("doubled")))

    def _execute(self) -> None:
        """Executes the PLC's writes in their order; late ones are left for a later cycle."""
        while self._writes and (len(self._writes) > MOST_UNDER_WAY or not self._hits("late")):
            assert self.station.write(WRITTEN_AT, self._writes.popleft(), self._now) is None

    def _runtime(self) -> None:
        order = self.station.order
        if order is None:
            self._ends_s = self._now + MOST_PART_S * self._random.random()
        elif self._now >= self._ends_s:
            x = self._random.randrange(2**32)
            self.given.append((order.trigger_id, x))
            self.station.finish(Answer(1, x=x))

    def _read(self) -> None:
        """Requests the registers, and takes each answer that arrives, unless a newer one was taken before."""
        words = self.station.read(READ_AT, _LENGTH, self._now)
        assert isinstance(words, list)
        self._number += 1
        if not self._hits("dropped"):
            self._answers.extend([(self._number, words)] * (1 + self._hits("doubled")))
        while self._answers and (len(self._answers) > MOST_UNDER_WAY or not self._hits("late")):
            self._answers.rotate(-self._random.randrange(len(self._answers)))  # reordered
            number, words = self._answers.popleft()
            if number > self._newest:
                self._newest, self._seen = number, words
                error = words[_OFFSET["error_id"]]
                self.counts[f"error {error}"] += error > 0
            else:
                self.counts["discarded"] += number < self._newest

    def _interrupt(self) -> None:
        if self._hits("stands_still"):
            self._now += HEARTBEAT_LIMIT_S + 1
        power = self._hits("power")
        if power or self._hits("broken"):
            while self._writes and self._random.random() < 0.5:
                self.station.write(WRITTEN_AT, self._writes.popleft(), self._now)
            self._writes.clear()
            self._answers.clear()
            self.station.disconnect()
        if power:
            self._restart()

    def _restart(self) -> None:
        """Restarts the PLC; it continues with the part under way or with a result that it has not taken."""
        program = self.program
        program.restart()
        words = self.station.read(READ_AT, _LENGTH, self._now)
        assert isinstance(words, list)
        self._newest, self._seen = self._number, words
        if not SIGNALS[self.station.state].busy and not SIGNALS[self.station.state].result_valid:
            program.state = 0 if self.station.state is State.READY else 4


assert len(WRITTEN) == len(Program().image())
