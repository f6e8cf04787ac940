"""Explores the states of the OPC UA server: tries every event in every state that can be reached."""

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from runtime.devices.clock import SystemClock
from runtime.plc.exchange import Exchange
from runtime.plc.opcua import OpcUaServer
from runtime.plc.panel import Configuration, Offer, Panel
from runtime.plc.station import FAULT, Answer, Glance, Station

DIGESTS = ("d" * 64, "e" * 64)
OFFERS = [Offer("one", DIGESTS[0], []), Offer("two", DIGESTS[1], ["bracket", "shim"])]
LOCATED = Answer(1, 0, -1500, 250, 900_000, 1, 1, 20, 65535, 1.25)


class Line:
    """A server without clients; `events` maps the name of an event to a function that causes it."""

    def __init__(self, listener: socket.socket) -> None:
        self.exchange = Exchange(Station((1, 2), beats=False), SystemClock())
        self.panel = Panel(OFFERS, Configuration("linear map", ""), self.exchange.glance)
        self.exchange.watch = self.panel.see
        self.server = OpcUaServer(listener, self.exchange, self.panel, None)
        self.server._unprepare()
        self.events: dict[str, Callable[[], object]] = {
            "SelectModeAutomatic": self.server._select_automatic,
            "PrepareRecipe": lambda: self.server._prepare("two"),
            "UnprepareRecipe": self.server._unprepare,
            "StartSingleJob": lambda: self.server._start("m"),
            "the part ends": lambda: self.exchange.finish(LOCATED),
            "the part ends with a fault": lambda: self.exchange.finish(Answer(FAULT, 20)),
            "ReleaseResultHandle": lambda: self.server._release(self.panel.job.number),
            "ConfirmAll": self.server._confirm_all,
            "Stop": self.server._withdraw,
            "Reset": self.server._reset,
            "the master's session ends": self.exchange.disconnect,
            "the run ends": self.exchange.end,
        }


@contextmanager
def line() -> Iterator[Line]:
    """A context with a new `Line`."""
    with socket.socket() as listener:
        yield Line(listener)


def _key(seen: Glance) -> tuple[object, ...]:
    flags = seen.order is not None, seen.enabled, seen.ended, bool(seen.error_id)
    return (seen.state, seen.answer.outcome, seen.table, *flags)


def explored() -> Iterator[tuple[Glance, str, Glance]]:
    """Tries every event in every reachable state; yields (glance before, name of the event, glance after).

    A glance is a snapshot of the station. Glances that differ only in the numbers of jobs count as one state.
    """
    known: dict[tuple[object, ...], tuple[str, ...]] = {}
    ahead: list[tuple[str, ...]] = [()]
    while ahead:
        way = ahead.pop()
        with line() as each:
            for name in way:
                each.events[name]()
            here = each.exchange.glance
            names = list(each.events)
        if _key(here) in known:
            continue
        known[_key(here)] = way
        for name in names:
            with line() as each:
                for step in way:
                    each.events[step]()
                before = each.exchange.glance
                each.events[name]()
                yield before, name, each.exchange.glance
            ahead.append((*way, name))
