"""An OPC UA client for tests: asyncua behind blocking calls, which find nodes by their path of names."""

import asyncio
import threading
from collections.abc import Coroutine
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from asyncua import Client, Node, ua
from asyncua.crypto.cert_gen import (
    dump_private_key_as_pem,
    generate_private_key,
    generate_self_signed_app_certificate,
)
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtendedKeyUsageOID
from programs import WAIT_S, Closing, until

from runtime.plc.address_space import NAMESPACE, SYSTEM
from runtime.plc.panel import AUTOMATIC, MACHINE, RECIPES, RESULTS

URI = "urn:line:supervisor"


class Passport(NamedTuple):
    """Paths of a client's certificate (DER, the only file of its folder) and key (PEM)."""

    certificate: Path
    key: Path


def passport(folder: Path, name: str) -> Passport:
    """Writes a new self-signed certificate and its key into a folder."""
    key = generate_private_key()
    names = [x509.UniformResourceIdentifier(URI), x509.DNSName("localhost")]
    use = [ExtendedKeyUsageOID.CLIENT_AUTH]
    certificate = generate_self_signed_app_certificate(key, name, {}, names, use)
    files = Passport(folder / name / "client.der", folder / f"{name}.pem")
    files.certificate.parent.mkdir()
    files.certificate.write_bytes(certificate.public_bytes(Encoding.DER))
    files.key.write_bytes(dump_private_key_as_pem(key))
    return files


class Supervisor(Closing):
    """A connected client; with a passport it uses the encrypted endpoint."""

    def __init__(
        self, port: int, identity: Passport | None = None, *, patience_s: float = WAIT_S
    ) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self.client = Client(f"opc.tcp://127.0.0.1:{port}", timeout=patience_s)
        self.client.application_uri = URI
        self.events: list[str] = []
        self._nodes: dict[str, Node] = {}
        try:
            until(lambda: self._connects(identity), "it listens")
        except BaseException:
            self._end_loop()
            raise

    def _connects(self, identity: Passport | None) -> bool:
        """Connects; returns False if the server does not listen yet."""
        try:
            self.wait(self._connect(identity))
        except ConnectionRefusedError:
            return False
        return True

    async def _connect(self, identity: Passport | None) -> None:
        if identity is not None:
            await self.client.set_security(
                SecurityPolicyBasic256Sha256,
                certificate=str(identity.certificate),
                private_key=str(identity.key),
                mode=ua.MessageSecurityMode.SignAndEncrypt,
            )
        await self.client.connect()
        self._index = await self.client.get_namespace_index(NAMESPACE)

    def wait(self, doing: Coroutine[Any, Any, Any]) -> Any:
        """Runs a coroutine in the client's event loop; returns its result."""
        running: Future[Any] = asyncio.run_coroutine_threadsafe(doing, self._loop)
        return running.result(WAIT_S)

    def node(self, path: str) -> Node:
        """The node at a path below `VisionSystem`, found by browsing."""
        if path not in self._nodes:
            names = [SYSTEM, *path.split("/")]
            standard = {"CurrentState", "LastTransition", "Id"}
            steps = [f"{0 if name in standard else self._index}:{name}" for name in names]
            self._nodes[path] = self.wait(self.client.nodes.objects.get_child(steps))
        return self._nodes[path]

    def __getitem__(self, path: str) -> Any:
        value = self.wait(self.node(path).read_value())
        return value.Text if isinstance(value, ua.LocalizedText) else value

    def until(self, path: str, value: object) -> None:
        """Waits until the variable at a path has a value."""
        until(lambda: self[path] == value, f"{path} is {value}")

    def call(self, path: str, *inputs: object) -> Any:
        """Calls the method at a path; returns its outputs."""
        parent, _, name = path.rpartition("/")
        return self.wait(self.node(parent).call_method(f"{self._index}:{name}", *inputs))

    def follow(self) -> None:
        """Subscribes to the server's transitions: from now on `events` collects their names."""
        self.wait(self._follow(self.node(MACHINE)))

    async def _follow(self, machine: Node) -> None:
        subscription = await self.client.create_subscription(20, self)
        await subscription.subscribe_events(machine, ua.ObjectIds.TransitionEventType)

    def event_notification(self, event: Any) -> None:
        """Adds a transition to `events`; asyncua calls this."""
        self.events.append(event.Message.Text)

    def begin(self, recipe: str) -> None:
        """Selects the automatic mode and a recipe."""
        assert self.call(f"{MACHINE}/SelectModeAutomatic") == [0, ""]
        assert self.call(f"{RECIPES}/PrepareRecipe", recipe) == [0, ""]

    def start(self, meas_id: str) -> str:
        """Starts a job; returns its id."""
        job, error, message = self.call(f"{AUTOMATIC}/StartSingleJob", meas_id)
        assert error == 0, message
        return str(job)

    def result(self, job: str) -> dict[str, Any]:
        """Waits for the result of a job, and returns its fields by name."""
        self.until(f"{RESULTS}/ResultReady", True)
        names = [each.Name for each in self.wait(self._outputs())]
        return dict(zip(names, self.call(f"{RESULTS}/GetResultById", job), strict=True))

    async def _outputs(self) -> Any:
        steps = [f"{self._index}:{name}" for name in (SYSTEM, RESULTS, "GetResultById")]
        parent = await self.client.nodes.objects.get_child(steps)
        return await (await parent.get_child("0:OutputArguments")).read_value()

    def release(self, handle: int) -> None:
        """Releases the result with a handle, so that the server may discard it."""
        given = ua.Variant(handle, ua.VariantType.UInt32)
        assert self.call(f"{RESULTS}/ReleaseResultHandle", given) == [0, ""]

    def part(self, meas_id: str) -> dict[str, Any]:
        """Locates one part: starts a job, and gets and releases its result."""
        result = self.result(self.start(meas_id))
        self.release(result["ResultHandle"])
        return result

    def vanish(self) -> None:
        """Breaks the connection without closing the session."""
        self._loop.call_soon_threadsafe(self.client.uaclient.protocol.transport.abort)
        self._end_loop()

    def close(self) -> None:
        if self._loop.is_closed():
            return
        with suppress(Exception):  # the server may have ended
            self.wait(self.client.disconnect())
        self._end_loop()

    def _end_loop(self) -> None:
        async def cancelled() -> None:
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)

        with suppress(Exception):
            asyncio.run_coroutine_threadsafe(cancelled(), self._loop).result(WAIT_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(WAIT_S)
        self._loop.close()
