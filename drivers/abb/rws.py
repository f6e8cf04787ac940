"""Client of Robot Web Services 2 on an ABB OmniCore controller (RobotWare 7): resources over HTTPS.

There is one connection, with one request at a time. A request has a single deadline (for connection,
handshake, sign-in and answer), and its answer has a size limit. After a failure the connection is renewed, so
that a late answer is not taken for the answer to a later request. Sign-in is Basic, or Digest if the
controller requires it. User and password come from the environment, since an address is printed and
journalled. Neither is sent before the certificate is verified, unless the environment variable of the
certificate is "any".
"""

import base64
import hashlib
import http.client
import json
import os
import re
import secrets
import ssl
from collections.abc import Mapping
from typing import Any, cast
from urllib.parse import quote, urlencode
from urllib.request import parse_http_list, parse_keqv_list

from drivers.bounds import BoundedSocket, EndlessError
from drivers.clock import Pace
from drivers.errors import ReadOnlyError, read_late, shown
from drivers.stream import closed_on_error, connected

ANSWER_S = 4.0  # wall; controllers take some tenths of a second under load
MOST_BYTES = 1 << 20  # of an answer with its headers; usual ones have less than 10 kB
USER, PASSWORD = "SQUEEZETREE_RWS_USER", "SQUEEZETREE_RWS_PASSWORD"
CERTIFICATE = "SQUEEZETREE_RWS_CERTIFICATE"  # a PEM file, the SHA-256 of a certificate, or "any"
ANY = "any"
SHA256 = re.compile(r"(?:[0-9A-Fa-f]{2}:?){32}")
FACTORY = ("Default User", "robotics")  # user and password of a new controller, documented by ABB
ACCEPT = "application/hal+json;v=2.0"
FORM = "application/x-www-form-urlencoded;v=2.0"
State = Mapping[str, Any]


class RwsError(OSError):
    """The controller does not answer, or refuses."""


class Rws:
    """A session with a controller; connects at the first request. With `read_only`, `post` is refused."""

    def __init__(self, host: str, port: int, pace: Pace, *, read_only: bool = False) -> None:
        self._host, self._port = host, port
        self._pace = pace
        self._read_only = read_only
        self._user = os.environ.get(USER, FACTORY[0]), os.environ.get(PASSWORD, FACTORY[1])
        self._connection: http.client.HTTPSConnection | None = None
        self._cookies: dict[str, str] = {}
        self._challenge: dict[str, str] = {}  # of a controller that requires Digest
        self._count = 0

    def state(self, path: str, **query: str) -> list[State]:
        """Reads a resource; returns its `state` records, at least one.

        Raises:
            RwsError: no answer in time, a refusal, or no such resource.
        """
        target = path + ("?" + urlencode(query, quote_via=quote) if query else "")
        for _ in range(2):
            since = self._pace.now()
            body = self._request("GET", target, "")
            late_s = self._pace.now() - since - ANSWER_S
            if late_s <= 0.0:  # otherwise the answer is out of date
                return _states(path, body)
        raise RwsError(f"it {read_late(late_s)}")

    def post(self, path: str, form: Mapping[str, str], **query: str) -> None:
        """Requests a change; does not repeat a request that fails.

        Raises:
            RwsError: no answer in time (it is then unknown whether the change was made), or a refusal.
            ReadOnlyError: the session only reads.
        """
        body = urlencode(form, quote_via=quote)
        if self._read_only:
            raise ReadOnlyError(f"a dry run was about to send {path} {body!r} to arm {self._host}")
        self._request("POST", path + ("?" + urlencode(query) if query else ""), body)

    def close(self) -> None:
        """Disconnects."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _request(self, method: str, target: str, body: str) -> str:
        until = self._pace.now() + ANSWER_S
        status, headers, text = self._exchange(method, target, body, until)
        if status == http.client.UNAUTHORIZED and not self._challenge and self._take(headers):
            status, headers, text = self._exchange(method, target, body, until)
        if status == http.client.UNAUTHORIZED:
            raise RwsError(
                f"the controller refuses the user {self._user[0]!r}; set {USER} and {PASSWORD}"
            )
        if not 200 <= status < 300:
            raise RwsError(
                f"the controller answered {method} {target} by {status}: {_message(text)}"
            )
        return text

    def _exchange(
        self, method: str, target: str, body: str, until: float
    ) -> tuple[int, http.client.HTTPMessage, str]:
        headers = {"Accept": ACCEPT, "Authorization": self._authorization(method, target)}
        if self._cookies:
            headers["Cookie"] = "; ".join(f"{key}={value}" for key, value in self._cookies.items())
        if method == "POST":
            headers["Content-Type"] = FORM
        try:
            # Closed after an error, so that a late answer is not taken for the answer to a later request.
            with closed_on_error(self):
                if self._connection is None or self._connection.sock is None:
                    self._connection = self._connected(until)
                connection = self._connection
                cast(BoundedSocket, connection.sock).allow(until, MOST_BYTES)
                connection.request(method, target, body if method == "POST" else None, headers)
                with connection.getresponse() as answer:
                    text = _whole(answer).decode("utf-8", "replace")
        except RwsError:
            raise
        except EndlessError as error:
            problem = f"the answer to {method} {target} is longer than {MOST_BYTES} bytes"
            raise RwsError(problem) from error
        except (OSError, http.client.HTTPException, ValueError) as error:
            reason = shown(error) if str(error) else type(error).__name__
            raise RwsError(f"no answer to {method} {target} ({reason})") from error
        for cookie in answer.headers.get_all("Set-Cookie") or ():
            name, _, value = cookie.partition(";")[0].strip().partition("=")
            self._cookies[name] = value
        return answer.status, answer.headers, text

    def _connected(self, until: float) -> http.client.HTTPSConnection:
        """Connects before a deadline, and checks the controller's certificate.

        Raises:
            RwsError: the certificate is not the one that the environment variable states, the variable is not
                set, or the file that it names cannot be read.
            OSError: no connection in time.
        """
        stated = os.environ.get(CERTIFICATE, "")
        in_file = stated not in ("", ANY) and not SHA256.fullmatch(stated)
        try:
            context = ssl.create_default_context(cafile=stated if in_file else None)
        except OSError as error:
            raise RwsError(
                f"{CERTIFICATE}: {stated} cannot be read as certificates ({error})"
            ) from error
        context.check_hostname = False  # controllers are reached by address, and self-signed
        if not in_file:
            context.verify_mode = ssl.CERT_NONE
        plain = connected(self._host, self._port, max(until - self._pace.now(), 1e-3))
        with closed_on_error(plain):
            plain.settimeout(max(until - self._pace.now(), 1e-3))
            # The timeout limits the whole handshake (Modules/_ssl.c).
            secure = context.wrap_socket(plain, server_hostname=self._host)
        certificate = hashlib.sha256(secure.getpeercert(binary_form=True) or b"").hexdigest()
        if not in_file and stated != ANY and certificate != stated.replace(":", "").lower():
            secure.close()
            message = "is another than was stated" if stated else "is not known"
            raise RwsError(
                f"the controller's certificate {message}, and no password was sent; "
                "if it is the controller's "
                f"own, set {CERTIFICATE} to its SHA-256: {certificate}"
            )
        connection = http.client.HTTPSConnection(self._host, self._port, context=context)
        connection.auto_open = 0  # connects only here
        connection.sock = BoundedSocket(secure, self._pace.now)
        return connection

    def _authorization(self, method: str, target: str) -> str:
        user, password = self._user
        if not self._challenge:
            return "Basic " + base64.b64encode(f"{user}:{password}".encode()).decode("ascii")
        self._count += 1
        given, cnonce, count = self._challenge, secrets.token_hex(8), f"{self._count:08x}"
        realm, nonce = given["realm"], given["nonce"]
        ours, asked = _md5(f"{user}:{realm}:{password}"), _md5(f"{method}:{target}")
        response = _md5(f"{ours}:{nonce}:{count}:{cnonce}:auth:{asked}")
        fields = {"username": user, "realm": realm, "nonce": nonce, "uri": target, "cnonce": cnonce}
        fields["response"] = response
        if "opaque" in given:
            fields["opaque"] = given["opaque"]
        quoted = ", ".join(f'{name}="{value}"' for name, value in fields.items())
        return f"Digest {quoted}, qop=auth, nc={count}"

    def _take(self, headers: http.client.HTTPMessage) -> bool:
        """Keeps the Digest challenge (MD5, RFC 7616) of a response; returns whether there is one."""
        for challenge in headers.get_all("WWW-Authenticate") or ():
            scheme, _, rest = challenge.partition(" ")
            try:
                given = parse_keqv_list(parse_http_list(rest)) if scheme.lower() == "digest" else {}
            except ValueError:  # garbled
                continue
            algorithm = given.get("algorithm", "MD5").upper()
            if algorithm == "MD5" and {"realm", "nonce"} <= given.keys():
                self._challenge = given
                return True
        return False


def _whole(answer: http.client.HTTPResponse) -> bytes:
    """Reads the body of an answer; allocates at most `MOST_BYTES`, whatever length the controller states."""
    body = answer.read(MOST_BYTES)
    if answer.length:
        raise http.client.IncompleteRead(body, answer.length)
    return body


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()


def _states(path: str, body: str) -> list[State]:
    try:
        record = json.loads(body)["state"]
        if isinstance(record, list) and record and all(isinstance(state, dict) for state in record):
            return record
    except (ValueError, KeyError, TypeError, RecursionError):
        pass
    raise RwsError(f"the controller's answer for {path} is not understood: '{shown(body)}'")


def _message(text: str) -> str:
    """Returns the reason that an error answer states, or else the beginning of the answer."""
    try:
        return shown(json.loads(text)["status"]["msg"])
    except (ValueError, KeyError, TypeError, RecursionError):
        return shown(text) if text else "no reason given"
