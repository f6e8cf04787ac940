"""Signed packs of tables, for tests of commands that read packs."""

from runtime.signing.keys import SigningKey, _ed25519
from runtime.signing.pack import signed
from runtime.table import TableFile, dumps, loads

FACTS = {"signer": "ada@example", "created": "2026-11-27T03:00:00.000+00:00"}
FACTS["versions"] = {"squeezetree": "0.1.0"}


def new_key() -> SigningKey:
    """A new signing key, which is not written to a file."""
    return SigningKey(_ed25519().Ed25519PrivateKey.generate())


def pack_of(table, key: SigningKey, calibration: bytes | None = None) -> bytes:
    """The bytes of a signed pack of a table."""
    data = dumps(table)
    return signed(TableFile(loads(data), data, ""), calibration, key, FACTS)
