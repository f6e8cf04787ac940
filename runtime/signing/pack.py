"""A signed pack: table, calibration, job, versions and digests in one zip archive.

`manifest.json` states the signer, and the SHA-256 of each other member. The archive's comment is the
signature of all bytes before it: so the pack is one file, which OpenSSL alone can check
(tools/docs/evidence.md).
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.errors import PackError
from runtime.shell import strict_json
from runtime.shell.errors import InputError
from runtime.shell.files import read_input
from runtime.shell.plain_text import unprintable
from runtime.signing.archive import SIGNATURE_BYTES, members_of, unsigned
from runtime.signing.keys import PublicKey, SigningKey, parse_public
from runtime.table import TableFile

KIND, VERSION = "squeezetree pack", 1
MANIFEST, KEY, TABLE, JOB, CALIBRATION = MEMBERS = (
    "manifest.json",
    "public-key.pem",
    "table.msgpack",
    "job.json",
    "calibration.json",
)
REQUIRED = (MANIFEST, KEY, TABLE)
MOST_BYTES = 16 << 20


@dataclass(frozen=True, slots=True)
class Pack:
    """The content of a pack whose signature was checked and is valid."""

    members: Mapping[str, bytes]  # contents by name, the manifest first
    manifest: Mapping[str, Any]  # the manifest
    key: PublicKey  # key of the signer
    digest: str  # SHA-256 of the file

    def fields(self) -> dict[str, object]:
        """The manifest, the key's fingerprint and the file's digest, as fields of a JSON object."""
        stated = {
            name: value for name, value in self.manifest.items() if name not in ("kind", "version")
        }
        return {**stated, "fingerprint": self.key.fingerprint, "pack_sha256": self.digest}


def signed(
    table: TableFile, calibration: bytes | None, key: SigningKey, facts: Mapping[str, object]
) -> bytes:
    """Builds and signs a pack; returns the bytes of its file.

    Args:
        table: the table; its job is included, unless it was stripped.
        calibration: the bytes of the calibration's file, if there is one.
        key: the key of the signer.
        facts: further fields of the manifest: `signer`, `created`, `versions`.
    """
    job = table.table.job
    contents = {KEY: key.public.pem, TABLE: table.data}
    contents |= {} if job is None else {JOB: job.encode()}
    contents |= {} if calibration is None else {CALIBRATION: calibration}
    manifest = {
        "kind": KIND,
        "version": VERSION,
        **facts,
        "compiled_by": table.table.tool,
        "job_sha256": table.table.job_digest.hex(),
        "sha256": _digests(contents),
    }
    text = json.dumps(manifest, indent=1, ensure_ascii=True, allow_nan=False) + "\n"
    body = unsigned({MANIFEST: text.encode(), **contents})
    return body + key.sign(body)


def read(path: Path) -> bytes:
    """Reads a pack's file.

    Raises:
        InputError: the file cannot be read, or is too large for a pack.
    """
    return read_input(path, MOST_BYTES, f"pack {path}")[0]


def verified(data: bytes, trusted: PublicKey | None = None) -> Pack:
    """Checks every byte of a pack, and parses it.

    Args:
        data: the bytes of its file.
        trusted: the key that must have signed the pack. None: the key in the pack itself; the check then
            shows that nothing was changed, but not who signed.

    Raises:
        PackError: the pack was changed, or signed by another key; the message says which.
        UsageError: the extra for signatures is not installed.
    """
    members = members_of(data, MEMBERS)
    for name in REQUIRED:
        if name not in members:
            raise PackError(f"lacks {name}")
    manifest = _manifest(members)
    try:
        key = parse_public(members[KEY])
    except ValueError as error:
        raise PackError(f"{KEY} {error}") from error
    if trusted is not None and key != trusted:
        raise PackError(
            f"is signed by another key, of {manifest['signer']}: its fingerprint is {key.fingerprint}, asked "
            f"for is {trusted.fingerprint}"
        )
    if not key.signed(data[:-SIGNATURE_BYTES], data[-SIGNATURE_BYTES:]):
        raise PackError(
            f"its signature does not hold: the signature, {MANIFEST} or what it lists was changed after "
            f"{manifest['signer']} signed it"
        )
    return Pack(members, manifest, key, hashlib.sha256(data).hexdigest())


def covering(tree: Path, table: bytes, calibration: bytes | None, trusted: PublicKey) -> Pack:
    """Finds a signed pack that contains the table and the calibration of a run.

    Args:
        tree: the table's file; packs are looked for beside it, as `*.zip`. If `tree` is a link, they are
            also looked for beside the file to which it leads.
        table: the table's bytes.
        calibration: the bytes of the calibration's file, None for a run without one.
        trusted: the key that must have signed.

    Raises:
        PackError: there is no such pack; the message says why each pack is refused.
        UsageError: the extra for signatures is not installed.
    """
    wanted = {TABLE: table} if calibration is None else {TABLE: table, CALIBRATION: calibration}
    reasons = []
    # the folder of a link, and the folder of the file to which it leads
    folders = sorted({tree.parent.resolve(), tree.resolve().parent})
    for path in (path for folder in folders for path in sorted(folder.glob("*.zip"))):
        try:
            pack = verified(read(path), trusted)
        except (PackError, InputError) as error:
            reasons.append(f"{path.name} {error}")
            continue
        if all(pack.members.get(name) == wanted.get(name) for name in (TABLE, CALIBRATION)):
            return pack
        differs = TABLE if pack.members[TABLE] != table else CALIBRATION
        reasons.append(f"{path.name} is signed, but its {differs} is not the one of this run")
    why = "; ".join(reasons) or "there is no pack beside it"
    raise PackError(f"table {tree} is not covered by a signature of the required key: {why}")


def _manifest(members: Mapping[str, bytes]) -> Mapping[str, Any]:
    try:
        manifest: Mapping[str, Any] = strict_json.parse(members[MANIFEST])
    except ValueError as error:
        raise PackError(f"{MANIFEST} is {error}") from error
    others = _digests({name: content for name, content in members.items() if name != MANIFEST})
    is_pack = isinstance(manifest, dict) and manifest.get("kind") == KIND
    if not is_pack or manifest.get("version") != VERSION:
        raise PackError(f"{MANIFEST} is not the manifest of a pack of version {VERSION}")
    stated = manifest.get("sha256")
    if not isinstance(stated, dict) or unprintable(manifest) is not None:
        raise PackError(f"{MANIFEST} lists no digests, or does not print")
    for name in {**others, **stated}:
        if others.get(name) != stated.get(name):
            raise PackError(f"{name} is not the file that {MANIFEST} lists")
    if not all(isinstance(manifest.get(name), str) for name in ("signer", "created")):
        raise PackError(f"{MANIFEST} does not say who signed, or when")
    return manifest


def _digests(contents: Mapping[str, bytes]) -> dict[str, str]:
    return {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
