"""The thread of a PLC's server: it starts, fails and ends where the main thread notices."""

import asyncio
import threading

import pytest

from runtime.devices.clock import SystemClock
from runtime.plc.exchange import Exchange
from runtime.plc.server import PlcServer
from runtime.plc.station import Station


class Scripted(PlcServer):
    """A server that starts and fails as a test says."""

    def __init__(self, *, starts: bool = True, fails: bool = False) -> None:
        super().__init__(Exchange(Station((1,)), SystemClock()))
        self._starts, self._fails, self.ended = starts, fails, False
        self.entered = threading.Event()

    async def serve(self, stop: asyncio.Event) -> None:
        if self._starts:
            self.started.set()
            await asyncio.to_thread(self.entered.wait, 30)
        if self._fails:
            raise OSError("no descriptor is left")
        await stop.wait()
        self.ended = True


def test_server_that_starts_ends_when_it_is_left():
    with Scripted() as server:
        server.entered.set()
        server.check()
    assert server.ended
    assert not server._thread.is_alive()


def test_server_that_cannot_start_raises_why():
    with pytest.raises(OSError, match="no descriptor"), Scripted(starts=False, fails=True):
        pass


def test_server_that_fails_later_ends_enabling_and_says_why() -> None:
    server = Scripted(fails=True)
    server.exchange.put({"enable": 1})
    server.exchange.connected = True
    with server:
        server.entered.set()
        server._thread.join(30)
        with pytest.raises(OSError, match="no descriptor"):
            server.check()
        assert (server.exchange.glance.enabled, server.exchange.connected) == (False, False)
