"""The exchange between a PLC's server and the run."""

import pytest

from runtime.plc.exchange import Exchange
from runtime.plc.registers import HEARTBEAT_LIMIT_S
from runtime.plc.station import Station


class Watch:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.s = 100.0

    def now(self) -> float:
        return self.s


@pytest.mark.parametrize(("silent_s", "withdrawn"), [(-0.1, False), (0.1, True)])
def test_glance_heartbeat_stopped_without_reads_withdraws_the_order(silent_s, withdrawn):
    """A PLC that freezes with its connection open neither reads nor writes: only the run looks."""
    clock = Watch()
    exchange = Exchange(Station((1,)), clock)
    exchange.put({"enable": 1, "heartbeat_in": 1}, {"trigger_id": 5, "trigger": 1})
    clock.s += HEARTBEAT_LIMIT_S + silent_s
    seen = exchange.glance
    assert seen.order is not None
    assert (seen.withdrawn, seen.enabled) == (withdrawn, not withdrawn)


def test_glance_next_trigger_is_not_withdrawn():
    exchange = Exchange(Station((1,)), Watch())
    exchange.put({"enable": 1}, {"enable": 0}, {"enable": 1})
    assert exchange.glance.withdrawn
    exchange.put({"trigger_id": 5, "trigger": 1})
    assert not exchange.glance.withdrawn
