"""The thread of a PLC's server: the main thread notices its start, failure and end."""

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


def test_plc_server_ends_on_exit():
    with Scripted() as server:
        server.entered.set()
        server.check()
    assert server.ended
    assert not server._thread.is_alive()


def test_plc_server_failed_start_raises_cause():
    with pytest.raises(OSError, match="no descriptor"), Scripted(starts=False, fails=True):
        pass


def test_plc_server_later_failure_disables_and_raises_cause() -> None:
    server = Scripted(fails=True)
    server.exchange.put({"enable": 1})
    server.exchange.connected = True
    with server:
        server.entered.set()
        server._thread.join(30)
        with pytest.raises(OSError, match="no descriptor"):
            server.check()
        assert (server.exchange.glance.enabled, server.exchange.connected) == (False, False)
