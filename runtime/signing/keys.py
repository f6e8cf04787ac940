"""Ed25519 keys in PEM files, as OpenSSL reads and writes them.

A private key is a file that only its owner may read, and is never overwritten. The library for signatures,
`cryptography`, is loaded on demand.
"""

import base64
import hashlib
import os
import stat
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.shell.errors import InputError, UsageError
from runtime.shell.files import OutputError, bring_to_disk, quoted, read_input, usable

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric import ed25519

# Prefix of a public key in DER (RFC 8410, section 4).
_PREFIX = bytes.fromhex("302a300506032b6570032100")
_MOST_BYTES = 1 << 16
_REMEDY = "; squeezetree key makes one"
OTHERS = stat.S_IRWXG | stat.S_IRWXO


@dataclass(frozen=True, slots=True)
class PublicKey:
    """A public key; two objects are equal if they are the same key."""

    raw: bytes  # 32 bytes

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the key in DER: `openssl pkey -pubin -in K.pub -outform DER | sha256sum`."""
        return hashlib.sha256(_PREFIX + self.raw).hexdigest()

    @property
    def pem(self) -> bytes:
        """The content of the key's file."""
        text = base64.b64encode(_PREFIX + self.raw)
        return b"-----BEGIN PUBLIC KEY-----\n" + text + b"\n-----END PUBLIC KEY-----\n"

    def signed(self, data: bytes, signature: bytes) -> bool:
        """Whether `signature` is a signature of `data` by this key."""
        from cryptography.exceptions import InvalidSignature

        try:
            _ed25519().Ed25519PublicKey.from_public_bytes(self.raw).verify(signature, data)
        except InvalidSignature:
            return False
        return True


@dataclass(frozen=True, slots=True)
class SigningKey:
    """A private key."""

    private: "ed25519.Ed25519PrivateKey"

    @property
    def public(self) -> PublicKey:
        """The public key that belongs to this key."""
        return _public(self.private.public_key())

    def sign(self, data: bytes) -> bytes:
        """Signs data; returns the signature, 64 bytes."""
        return self.private.sign(data)


def public_of(path: Path) -> Path:
    """Path of the public key's file, beside the private key's file `path`."""
    return path.with_name(f"{path.name}.pub")


def generate(path: Path) -> SigningKey:
    """Creates a key, and writes two files: the private key with mode 0600, and beside it the public key.

    Raises:
        OutputError: one of the files exists or cannot be written; neither is left behind.
        UsageError: the extra for signatures is not installed.
    """
    from_library = _ed25519().Ed25519PrivateKey.generate()
    key, public = SigningKey(from_library), public_of(path)
    for file in (path, public):
        usable(file)
        if os.path.lexists(file):
            raise OutputError(f"{file} exists, and a key is never overwritten; name another file")
    write_new(path, _private_pem(from_library), 0o600)
    try:
        write_new(public, key.public.pem, 0o644)
        bring_to_disk(path.parent)
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    return key


def load_private(path: Path) -> SigningKey:
    """Reads a private key.

    Raises:
        InputError: the file cannot be read, may be read by others, or does not hold an Ed25519 private key;
            or the key has a passphrase.
        UsageError: the extra for signatures is not installed.
    """
    private = _ed25519().Ed25519PrivateKey
    data, mode = read_input(path, _MOST_BYTES, f"key {path}", _REMEDY)
    if b"PRIVATE KEY" not in data and b"PUBLIC KEY" in data:
        raise InputError(f"key {path} holds a public key; name the private one")
    if mode & OTHERS:
        raise InputError(f"key {path} may be read by others; chmod 600 {quoted(path)}")
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    try:
        loaded = load_pem_private_key(data, None)
    except TypeError:
        raise InputError(f"key {path} has a passphrase; name a key without one") from None
    except Exception as error:  # the library has several kinds of errors for unparsable files
        raise InputError(f"key {path} holds no private key in PEM{_REMEDY}") from error
    if not isinstance(loaded, private):
        raise InputError(f"key {path} holds {_kind(loaded)}; squeezetree key makes an Ed25519 key")
    return SigningKey(loaded)


def load_public(path: Path) -> PublicKey:
    """Reads a public key.

    Raises:
        InputError: the file cannot be read, or does not hold an Ed25519 public key.
        UsageError: the extra for signatures is not installed.
    """
    data, _ = read_input(path, _MOST_BYTES, f"key {path}", _REMEDY)
    if b"PRIVATE KEY" in data:
        raise InputError(
            f"key {path} holds a private key; name the public one, {public_of(path).name}"
        )
    try:
        return parse_public(data)
    except ValueError as error:
        raise InputError(f"key {path} {error}") from error


def parse_public(data: bytes) -> PublicKey:
    """Parses the public key in the bytes of a PEM file.

    Raises:
        ValueError: the bytes hold no public key, or one of another kind than Ed25519.
        UsageError: the extra for signatures is not installed.
    """
    public = _ed25519().Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    try:
        loaded = load_pem_public_key(data)
    except Exception as error:  # see `load_private`
        raise ValueError("holds no public key in PEM") from error
    if not isinstance(loaded, public):
        raise ValueError(f"holds {_kind(loaded)}, not an Ed25519 key")  # noqa: TRY004 - of a file's content
    return _public(loaded)


def _ed25519() -> Any:
    """Imports the module of the library `cryptography` that has the classes of Ed25519 keys.

    Raises:
        UsageError: the extra for signatures is missing.
    """
    try:
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ModuleNotFoundError:
        raise UsageError(
            "signatures need the evidence extra (cryptography is missing); install squeezetree[evidence]; "
            "in a clone: pip install '.[evidence]'"
        ) from None
    return ed25519


def _public(key: "ed25519.Ed25519PublicKey") -> PublicKey:
    return PublicKey(key.public_bytes_raw())


def _private_pem(key: "ed25519.Ed25519PrivateKey") -> bytes:
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


def _kind(key: object) -> str:
    """What kind of key an object of the library is, for a message: "an RSA key" for instance."""
    name = type(key).__name__.removesuffix("PrivateKey").removesuffix("PublicKey").strip("_")
    return f"{'an' if name[:1] in 'AEIORSX' else 'a'} {name} key"


def write_new(path: Path, data: bytes, mode: int) -> None:
    """Creates a file with this mode and content.

    Raises:
        OutputError: the file exists or cannot be written; a file that was begun is removed.
    """
    try:
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        file = os.open(path, flags, mode)
        try:
            os.fchmod(file, mode)  # whatever the umask
            with open(file, "wb", closefd=False) as written:
                written.write(data)
            os.fsync(file)
        except BaseException:
            with suppress(OSError):
                path.unlink()
            raise
        finally:
            os.close(file)
    except OSError as error:
        raise OutputError(
            f"{path} cannot be written: {error.strerror}; name another file"
        ) from error
