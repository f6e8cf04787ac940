"""The OPC UA server over the network with asyncua's client. There is no cell: the tests end the parts."""

import asyncio
import os
import signal
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from asyncua import Client, ua
from asyncua.client.ua_client import UaClient
from asyncua.server.internal_session import InternalSession
from programs import until
from supervisor import Passport, Supervisor, passport
from vision_chart import LOCATED, OFFERS

from runtime.devices.clock import SystemClock
from runtime.plc import admission
from runtime.plc.certificates import PINNED, Trust, identity_in
from runtime.plc.exchange import Exchange
from runtime.plc.handshake import Error
from runtime.plc.opcua import OpcUaServer, Security
from runtime.plc.panel import (
    AUTOMATIC,
    CONFIGURATION,
    MACHINE,
    PACKML,
    RECIPES,
    RESULTS,
    Configuration,
    Panel,
)
from runtime.plc.station import FAULT, Answer, Station

STATE = f"{AUTOMATIC}/CurrentState"
TEXT = ua.VariantType.String


@dataclass
class Served:
    exchange: Exchange
    port: int
    pinned: Path
    identity: Passport
    other: Passport

    def end_part(self, answer: Answer = LOCATED) -> None:
        self.exchange.finish(answer)

    def supervisor(self) -> Supervisor:
        return Supervisor(self.port, self.identity)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """One server for all tests, since loading its address space is slow; each test restores its state."""
    folder = tmp_path_factory.mktemp("opcua")
    exchange = Exchange(Station((1, 2), beats=False), SystemClock())
    panel = Panel(OFFERS, Configuration("gripper.json", "c" * 64), exchange.glance)
    security = Security(identity_in(folder), Trust(folder / PINNED, None))
    with pytest.MonkeyPatch.context() as patch, socket.create_server(("127.0.0.1", 0)) as listener:
        patch.setattr(admission, "SESSION_S", 5.0)
        port = int(listener.getsockname()[1])
        identity, other = passport(folder, "identity"), passport(folder, "other")
        with OpcUaServer(listener, exchange, panel, security):
            with Supervisor(port, identity):  # the first certificate is the one that is pinned
                pass
            yield Served(exchange, port, folder / PINNED, identity, other)


@pytest.fixture
def line(served: Served) -> Iterator[Supervisor]:
    """A supervisor that is in command of a server in the state Ready."""
    with served.supervisor() as supervisor:
        supervisor.call(f"{MACHINE}/Reset")
        supervisor.begin("two")
        yield supervisor
        served.end_part()
        if supervisor[f"{RESULTS}/ResultReady"]:
            supervisor.release(supervisor[f"{RESULTS}/LastResult/ResultHandle"])
        supervisor.call(f"{MACHINE}/Reset")
    until(lambda: not served.exchange.connected)


def test_opcua_server_part_passes_states_and_has_result(served: Served, line: Supervisor) -> None:
    line.follow()
    assert (line[f"{MACHINE}/CurrentState"], line[STATE]) == ("Operational", "Ready")
    located = line[f"{PACKML}/Located"]
    job = line.start("plate 17")
    assert (line[STATE], line[f"{PACKML}/StateCurrentName"]) == ("SingleExecution", "Execute")
    assert (line[f"{MACHINE}/JobId"], line[f"{MACHINE}/MeasId"]) == (job, "plate 17")
    served.end_part()
    result = line.result(job)
    assert line[f"{PACKML}/StateCurrentName"] == "Complete"
    assert (result["ResultId"], result["MeasId"], result["RecipeId"]) == (job, "plate 17", "two")
    assert (result["X_mm"], result["Y_mm"], result["Angle_deg"]) == (-1.5, 0.25, 90.0)
    assert (result["Part"], result["Face"], result["Seconds"]) == ("shim", 1, 1.25)
    assert result["ConfigurationDigest"] == line[f"{CONFIGURATION}/Digest"] == "c" * 64
    for name in ("ResultId", "X_mm"):
        assert line[f"{RESULTS}/LastResult/{name}"] == result[name]
    line.release(result["ResultHandle"])
    assert (line[STATE], line[f"{PACKML}/StateCurrentName"]) == ("Ready", "Idle")
    assert line[f"{PACKML}/Located"] == located + 1
    until(lambda: len(line.events) >= 2)
    assert line.events == ["ReadyToSingleExecution", "SingleExecutionToReady"]
    assert line[f"{MACHINE}/LastTransition"] == "SingleExecutionToReady"


def test_opcua_server_shows_recipes_configuration_and_states(served, line):
    ids, digests = line.call(f"{RECIPES}/GetRecipeList")
    assert list(zip(ids, digests, strict=True)) == [(each.id, each.digest) for each in OFFERS]
    assert line[f"{RECIPES}/Recipes/one/Digest"] == OFFERS[0].digest
    assert line[f"{RECIPES}/PreparedDigest"] == OFFERS[1].digest
    assert line["ConfigurationManagement/ActiveConfiguration"] == "gripper.json"
    assert line["ConfigurationManagement/Digest"] == "c" * 64
    state = line.wait(line.node(f"{MACHINE}/Operational").read_browse_name())
    assert state.Name == "Operational"
    shown = line.wait(line.node(f"{STATE}/Id").read_value())
    assert shown == line.node(f"{AUTOMATIC}/Ready").nodeid


@pytest.mark.parametrize(
    ("path", "inputs", "problem"),
    [
        (f"{AUTOMATIC}/StartSingleJob", (), "BadArgumentsMissing"),
        (f"{AUTOMATIC}/StartSingleJob", ("a", "b"), "BadTooManyArguments"),
        (f"{AUTOMATIC}/StartSingleJob", (3,), "BadInvalidArgument"),
        (f"{AUTOMATIC}/StartSingleJob", (ua.Variant(None, TEXT),), "BadInvalidArgument"),
        (f"{AUTOMATIC}/StartSingleJob", (["a"],), "BadInvalidArgument"),
        (f"{AUTOMATIC}/StartSingleJob", ("a" * 101,), "BadOutOfRange"),
        (f"{RECIPES}/PrepareRecipe", (1.5,), "BadInvalidArgument"),
        (f"{RESULTS}/GetResultById", ("no result",), "BadNotFound"),
        (f"{RESULTS}/ReleaseResultHandle", (ua.Variant(99, ua.VariantType.UInt32),), "BadNotFound"),
        (f"{RESULTS}/ReleaseResultHandle", ("1",), "BadInvalidArgument"),
    ],
)
def test_opcua_server_bad_call_is_refused_and_begins_nothing(path, inputs, problem, served, line):
    with pytest.raises(ua.UaStatusCodeError) as refused:
        line.call(path, *inputs)
    assert type(refused.value).__name__ == problem
    assert served.exchange.glance.order is None
    assert line[STATE] == "Ready"


def test_opcua_server_second_job_is_refused_with_its_error(
    served: Served, line: Supervisor
) -> None:
    job = line.start("first")
    order = served.exchange.glance.order
    assert line.call(f"{AUTOMATIC}/StartSingleJob", "second")[:2] == ["", Error.PART_UNDER_WAY]
    assert served.exchange.glance.order == order
    served.end_part()
    line.result(job)
    refused = line.call(f"{AUTOMATIC}/StartSingleJob", "second")
    assert (refused[1], line[f"{MACHINE}/ErrorId"]) == (Error.RESULT_WAITS, Error.RESULT_WAITS)
    assert line.result(job)["MeasId"] == "first"
    assert served.exchange.glance.order is None


def test_opcua_server_write_of_variable_or_new_node_is_refused(
    served: Served, line: Supervisor
) -> None:
    node = line.node(f"{RESULTS}/LastResult/X_mm")
    with pytest.raises(ua.uaerrors.BadUserAccessDenied):
        line.wait(node.write_value(1.0))
    with pytest.raises(ua.UaStatusCodeError):
        line.wait(line.client.nodes.objects.add_object(2, "mine"))


def test_opcua_server_second_client_reads_and_may_not_command(served, line):
    job = line.start("a")
    served.end_part()
    line.result(job)
    with served.supervisor() as reader:
        assert reader[STATE] == "SingleExecution"
        assert reader.result(job)["MeasId"] == "a"
        for path, inputs in {
            f"{AUTOMATIC}/StartSingleJob": ("b",),
            f"{AUTOMATIC}/Stop": (),
            f"{AUTOMATIC}/Abort": (),
            f"{MACHINE}/Reset": (),
            f"{RESULTS}/ReleaseResultHandle": (ua.Variant(1, ua.VariantType.UInt32),),
        }.items():
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                reader.call(path, *inputs)
        assert reader[f"{RESULTS}/ResultReady"]


def test_opcua_server_vanished_master_loses_no_part_or_result(served: Served) -> None:
    with served.supervisor() as first:
        first.begin("one")
        first.follow()  # a subscription must not keep the session open
        job = first.start("a")
        first.vanish()
    with served.supervisor() as second:
        second.until(f"{MACHINE}/AutomaticSelected", False)
        assert (second[STATE], second[f"{MACHINE}/JobId"]) == ("SingleExecution", job)
        assert second[f"{MACHINE}/ErrorId"] == Error.CONNECTION_LOST
        served.end_part()
        result = second.result(job)
        assert result["MeasId"] == "a"
        second.release(result["ResultHandle"])
        assert second[f"{MACHINE}/CurrentState"] == "Preoperational"
        refused = second.call(f"{AUTOMATIC}/StartSingleJob", "b")
        assert refused[1] == Error.NOT_ENABLED
        assert served.exchange.glance.order is None
        assert second.call(f"{RESULTS}/GetResultById", job)[1] == job  # also once it is released


@pytest.mark.slow
def test_opcua_server_silent_master_loses_command(served: Served) -> None:
    with served.supervisor() as silent, served.supervisor() as other:
        silent.begin("one")
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            other.call(f"{MACHINE}/Reset")
        silent._loop.call_soon_threadsafe(time.sleep, admission.SESSION_S + 2.0)
        other.until(f"{MACHINE}/AutomaticSelected", False)
        assert other[f"{MACHINE}/ErrorId"] == Error.CONNECTION_LOST
        assert other.call(f"{MACHINE}/Reset") == [0, ""]


def test_opcua_server_fault_is_error_until_confirmed(served: Served, line: Supervisor) -> None:
    job = line.start("a")
    served.end_part(Answer(FAULT, 20))
    result = line.result(job)
    assert (result["Outcome"], result["ErrorId"], result["X_mm"]) == ("fault", 20, 0.0)
    assert line[f"{MACHINE}/CurrentState"] == "Error"
    assert (line[f"{PACKML}/StateCurrentName"], line[STATE]) == ("Aborted", "")
    assert line[f"{PACKML}/StopReason"] == "device fault"
    assert line.call(f"{MACHINE}/ConfirmAll") == [0, ""]
    assert line[f"{MACHINE}/ErrorId"] == 0
    assert line[f"{MACHINE}/CurrentState"] == "Operational"


def test_opcua_server_abort_requests_stop(served, line, monkeypatch):
    sent: list[tuple[int, int]] = []
    monkeypatch.setattr(os, "kill", lambda *what: sent.append(what))
    assert line.call(f"{AUTOMATIC}/Abort") == [0, ""]
    assert sent == [(os.getpid(), signal.SIGTERM)]


def test_opcua_server_certificate_not_pinned_is_refused(served: Served, line: Supervisor) -> None:
    assert served.pinned.read_bytes() == served.identity.certificate.read_bytes()
    with pytest.raises(ua.uaerrors.BadCertificateUntrusted):
        Supervisor(served.port, served.other)
    assert line[STATE] == "Ready"


def test_opcua_server_unencrypted_client_is_refused(served: Served, line: Supervisor) -> None:
    with pytest.raises(Exception, match=r"(?i)security|policy|endpoint|untrusted"):
        Supervisor(served.port, patience_s=20)


def test_opcua_server_bare_channel_enters_no_session(served: Served, line: Supervisor) -> None:
    """Session tokens are consecutive numbers; knowing one must not open a session without a certificate."""

    async def intrude() -> list[type]:
        ends: list[type] = []
        last = InternalSession._auth_counter  # the session of `line` is one of the last
        for token in range(last - 3, last):
            intruder = UaClient(timeout=20)
            await intruder.connect_socket("127.0.0.1", served.port)
            await intruder.send_hello(f"opc.tcp://127.0.0.1:{served.port}")
            opening = ua.OpenSecureChannelParameters()
            opening.RequestType = ua.SecurityTokenRequestType.Issue
            opening.SecurityMode = ua.MessageSecurityMode.None_
            opening.RequestedLifetime = 60_000
            await intruder.open_secure_channel(opening)
            intruder.protocol.authentication_token = ua.NodeId(token)
            entering = ua.ActivateSessionParameters()
            entering.UserIdentityToken = ua.AnonymousIdentityToken("anonymous")
            value = ua.ReadValueId(ua.NodeId(2256), ua.AttributeIds.Value)
            reading = intruder.read(ua.ReadParameters(NodesToRead=[value]))
            registering = intruder.register_server(ua.RegisteredServer())
            for act in (intruder.activate_session(entering), reading, registering):
                try:
                    await act
                    ends.append(type(None))
                except Exception as error:
                    ends.append(type(error))
            intruder.disconnect_socket()
        return ends

    assert type(None) not in asyncio.run(intrude())
    assert line[STATE] == "Ready"


@pytest.mark.parametrize("junk", [b"GET / HTTP/1.0\r\n\r\n", b"HELF\0\0\0\x08", b"\xff" * 4096])
def test_opcua_server_malformed_bytes_change_nothing(junk, served, line):
    with socket.create_connection(("127.0.0.1", served.port), timeout=20) as intruder:
        intruder.sendall(junk)
    assert line[STATE] == "Ready"


def test_opcua_server_offers_only_encrypted_endpoint(served: Served) -> None:
    async def endpoints() -> list[Any]:
        client = Client(f"opc.tcp://127.0.0.1:{served.port}")
        return list(await client.connect_and_get_server_endpoints())

    (only,) = asyncio.run(endpoints())
    assert only.SecurityPolicyUri.endswith("#Basic256Sha256")
    assert only.SecurityMode is ua.MessageSecurityMode.SignAndEncrypt
    assert [token.TokenType for token in only.UserIdentityTokens] == [ua.UserTokenType.Anonymous]
