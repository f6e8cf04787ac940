"""Adds access control to asyncua's server: who may connect, what a client may do, and when a session ends."""

import asyncio
import socket
from collections.abc import Callable
from contextvars import ContextVar
from typing import Any

from asyncua import Server, ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.binary_server_asyncio import BinaryServer
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession

from runtime.plc.certificates import Trust

SESSION_S = 10.0  # a session ends after so many seconds without a request
PATIENCE_S = 5.0  # time for a connection to begin a session
MOST_CONNECTIONS = 16
MOST_SUBSCRIPTIONS = 64
MOST_MESSAGE_BYTES = 1 << 20
NOBODY = User(role=UserRole.Anonymous)  # the user of a session that is not yet activated

# The session whose client is calling a method.
caller: ContextVar["Session"] = ContextVar("caller")


class ListeningServer(Server):
    """asyncua's server, changed to use a socket that listens already."""

    async def listen(self, listener: socket.socket) -> None:
        """Starts the server on a given socket; `Server.start` would open a new socket."""
        await self._setup_server_nodes()
        await self.iserver.start()
        host, port = listener.getsockname()[:2]
        self.limits.max_message_size = MOST_MESSAGE_BYTES
        self.bserver = BinaryServer(self.iserver, host, port, self.limits)
        self.bserver.set_policies(self._policies)
        loop = asyncio.get_running_loop()
        self.bserver._server = await loop.create_server(self.bserver._make_protocol, sock=listener)
        self.bserver.cleanup_task = asyncio.create_task(self.bserver._close_task_loop())


class GuardedServer(InternalServer):
    """asyncua's internal server with access control and with limits.

    Args:
        trust: decides which clients may connect; None: any client may.
        ended: called with each session that has ended.
    """

    def __init__(self, trust: Trust | None, ended: Callable[["Session"], None]) -> None:
        super().__init__(user_manager=self)
        self._trust, self.ended = trust, ended
        self.max_session_timeout_ms = 1e3 * SESSION_S
        self.max_pending_activation_seconds = PATIENCE_S
        self.max_connections = MOST_CONNECTIONS
        self.max_subscriptions = MOST_SUBSCRIPTIONS

    def create_session(self, name: str, user: User = NOBODY, **_external: bool) -> "Session":
        """Creates a session that ends with its connection.

        A session of asyncua's own class may outlive its connection. Then a client on another connection could
        take the session over, since its number can be guessed.
        """
        return Session(self, self.aspace, self.subscription_service, name, user=user)

    def register_server(self, *_: Any) -> None:
        """Refuses the service RegisterServer, which is for discovery servers only.

        asyncua would answer this request before the client is authenticated.
        """
        raise ServiceError(ua.StatusCodes.BadServiceUnsupported)

    def get_user(self, *_: Any, certificate: Any = None, **_names: Any) -> User:
        """Admits a client; returns a user who may read and call methods, but not change the address space.

        Args:
            certificate: the client's certificate; the secure channel has proved that the client holds its
                key.

        Raises:
            ServiceError: the certificate is not trusted.
        """
        if self._trust is None or self._trust.admits(certificate):
            return User(role=UserRole.User)
        raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)


class Session(InternalSession):
    """The session of a client; when the session ends, it calls the server's `ended`."""

    iserver: GuardedServer

    async def call(self, params: list[ua.CallMethodRequest]) -> list[ua.CallMethodResult]:
        """Calls methods for the client; meanwhile the context variable `caller` holds this session."""
        token = caller.set(self)
        try:
            results: list[ua.CallMethodResult] = await super().call(params)
            return results
        finally:
            caller.reset(token)

    async def close_session(self, delete_subs: bool = True) -> None:
        """Ends the session, and calls the server's `ended`."""
        await super().close_session(delete_subs)
        self.iserver.ended(self)
