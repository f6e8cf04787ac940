"""Certificates for an OPC UA server: that of the server, and those of the trusted clients.

The server's certificate is self-signed and is created once. A client's certificate must be equal to that of
the first client, or to one in a folder. Its dates and its issuer are not checked. The secure channel proves
that the client holds the certificate's key.
"""

import socket
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from asyncua.crypto import cert_gen
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID

from runtime.shell.errors import InputError, UsageError
from runtime.shell.files import OutputError, bring_to_disk, folder, quoted, read_input
from runtime.signing.keys import OTHERS, write_new

KEY, CERTIFICATE, PINNED = "server.pem", "server.der", "client.der"
DAYS = 7300  # the life of a cell: a certificate that expires stops the cell
MOST_BYTES = 1 << 16


@dataclass(frozen=True, slots=True)
class Identity:
    """The server's private key and its certificate; `uri` is the application's URI in the certificate."""

    key: RSAPrivateKey
    certificate: x509.Certificate
    uri: str


def identity_in(place: Path) -> Identity:
    """Reads the server's key and certificate from a folder; creates both if the folder has neither.

    Raises:
        OutputError: the folder or its files cannot be written.
        InputError: only one of the two files exists, a file cannot be read or holds something else, or other
            users may read the key.
    """
    key_at, certificate_at = place / KEY, place / CERTIFICATE
    if not (key_at.exists() or certificate_at.exists()):
        _make(folder(place))
    for half in (key_at, certificate_at):
        if not half.exists():
            raise _refused("only one half of an identity", half)
    data, mode = read_input(key_at, MOST_BYTES, str(key_at))
    if mode & OTHERS:
        raise InputError(f"may be read by others; chmod 600 {quoted(key_at)}", where=str(key_at))
    try:
        private = load_pem_private_key(data, None)
    except (ValueError, TypeError) as error:
        raise _refused("no private key in PEM", key_at) from error
    certificate = parsed(certificate_at)
    if not isinstance(private, RSAPrivateKey) or private.public_key() != certificate.public_key():
        raise _refused(f"not the key of {certificate_at.name}", key_at)
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        (uri, *_) = names.get_values_for_type(x509.UniformResourceIdentifier)
    except (x509.ExtensionNotFound, ValueError) as error:
        raise _refused("no application URI", certificate_at) from error
    return Identity(private, certificate, uri)


def _refused(content: str, file: Path) -> InputError:
    remedy = f"move {file.parent} away, and a new identity is made"
    return InputError(f"holds {content}; {remedy}", where=str(file))


class Trust:
    """Decides which clients are trusted: those with a certificate in a folder, or only the first to connect.

    Args:
        pinned: file in which the first client's certificate is kept.
        trusted: folder of the trusted clients' certificates (.der, .pem, .crt); None: the first client to
            connect is trusted.

    Raises:
        UsageError: the folder has no certificates.
        InputError: a file of the folder is not a certificate.
    """

    def __init__(self, pinned: Path, trusted: Path | None) -> None:
        self._pinned = pinned
        self._known: frozenset[bytes] | None = None
        if trusted is not None:
            self._known = frozenset(map(_der, _certificates(trusted)))
        elif pinned.exists():
            self._known = frozenset([_der(pinned)])

    def admits(self, certificate: bytes | None) -> bool:
        """Whether a client with this certificate may connect.

        Without a folder of trusted certificates, the first certificate is written to the file `pinned`; from
        then on only this certificate is admitted.
        """
        if certificate is None:
            return False
        if self._known is None:
            # Nothing is pinned if the disk is full, or if this is not exactly one certificate. The file
            # exists if another server has pinned a certificate meanwhile.
            with suppress(OutputError, InputError, ValueError):
                x509.load_der_x509_certificate(certificate)
                if not self._pinned.exists():
                    write_new(self._pinned, certificate, 0o644)
                    bring_to_disk(self._pinned.parent)
                self._known = frozenset([_der(self._pinned)])
        return self._known is not None and certificate in self._known


def parsed(path: Path) -> x509.Certificate:
    """Reads a certificate from a file in DER or PEM.

    Raises:
        InputError: the file cannot be read, or holds no certificate.
    """
    data, _ = read_input(path, MOST_BYTES, str(path))
    pem = data.lstrip().startswith(b"-----")
    try:
        return x509.load_pem_x509_certificate(data) if pem else x509.load_der_x509_certificate(data)
    except ValueError as error:
        problem = "holds no certificate in DER or PEM; remove it"
        raise InputError(problem, where=str(path)) from error


def _certificates(trusted: Path) -> list[Path]:
    files = [path for path in trusted.glob("*") if path.suffix in (".der", ".pem", ".crt")]
    if not files:
        raise UsageError(
            f"--plc-trusted {trusted}: it holds no certificate (.der, .pem, .crt); put the client's there"
        )
    return files


def _der(path: Path) -> bytes:
    return parsed(path).public_bytes(Encoding.DER)


def _make(place: Path) -> None:
    """Creates the server's key and self-signed certificate, and writes them to the folder `place`."""
    key, host = cert_gen.generate_private_key(), socket.gethostname()
    uri = f"urn:{host}:squeezetree:grasp-runtime"
    certificate = cert_gen.generate_self_signed_app_certificate(
        key,
        "squeezetree",
        {"organizationName": "squeezetree"},
        [x509.UniformResourceIdentifier(uri), x509.DNSName(host)],
        [ExtendedKeyUsageOID.SERVER_AUTH],
        DAYS,
    )
    write_new(place / KEY, cert_gen.dump_private_key_as_pem(key), 0o600)
    write_new(place / CERTIFICATE, certificate.public_bytes(Encoding.DER), 0o644)
    bring_to_disk(place)
