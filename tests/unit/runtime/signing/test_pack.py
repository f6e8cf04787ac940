"""Signed packs: a changed byte is refused with its file's name; only the trusted key's signature counts."""

import io
import json
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest
from packs import FACTS, new_key, pack_of
from refusals import refused_in_a_line
from sample_tables import small_table

from runtime.errors import PackError
from runtime.signing.archive import SIGNATURE_BYTES, unsigned
from runtime.signing.keys import public_of
from runtime.signing.pack import CALIBRATION, JOB, KEY, MANIFEST, MEMBERS, TABLE, covering, verified
from runtime.table import dumps

SIGNER = new_key()
PACK = pack_of(small_table(), SIGNER, b'{"format": 1}')


def resealed(members, key=SIGNER):
    body = unsigned(members)
    return body + key.sign(body)


def spans(data):
    """Start and end of each member, header and content together, as zipfile reads them."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        where = {}
        for info in archive.infolist():
            content = info.header_offset + 30 + len(info.filename)
            where[info.filename] = (info.header_offset, content + info.file_size)
        return where


def test_verified_returns_signed_members_and_manifest():
    pack = verified(PACK, SIGNER.public)
    assert list(pack.members) == [MANIFEST, KEY, TABLE, CALIBRATION]
    assert pack.members[TABLE] == dumps(small_table())
    assert {name: pack.manifest[name] for name in FACTS} == FACTS
    assert verified(PACK).key == SIGNER.public


def test_verified_flipped_byte_is_refused_with_file_name():
    where = spans(PACK)
    for at in range(len(PACK)):
        changed = bytearray(PACK)
        changed[at] ^= 1 << (at % 8)
        with pytest.raises(PackError) as refused:
            verified(bytes(changed))
        name = next((name for name, (start, end) in where.items() if start <= at < end), None)
        words = str(refused.value)
        if name is None:
            assert "zip's own fields" in words or "signature does not hold" in words, (at, words)
        elif at >= 4:
            renamed = "which is no file of a pack" in words
            assert name in words or renamed, (at, name, words)


CUTS = (0, 1, 3, 40, 700, len(PACK) - 100, len(PACK) - 64, len(PACK) - 1)
ADDED = PACK[:-SIGNATURE_BYTES] + b"x" + PACK[-SIGNATURE_BYTES:]


@pytest.mark.parametrize(
    "data",
    [*(PACK[:cut] for cut in CUTS), PACK + b"\0", b"\0" + PACK, PACK + PACK, ADDED],
    ids=[*(f"cut at {cut}" for cut in CUTS), "zero after", "zero before", "twice", "byte inside"],
)
def test_verified_truncated_or_extended_pack_is_refused(data):
    with pytest.raises(PackError):
        verified(data, SIGNER.public)


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "/etc/passwd", "table.msgpack/../x", "a\nb", "TABLE.MSGPACK"]
)
def test_verified_foreign_member_name_is_refused_in_one_line(name):
    members = verified(PACK).members
    with refused_in_a_line(PackError, "no file of a pack"):
        verified(resealed({**members, name: b"x"}), SIGNER.public)


def test_verified_duplicate_member_is_refused():
    body = PACK[: spans(PACK)[TABLE][1]]
    start, end = spans(PACK)[TABLE]
    with pytest.raises(PackError, match=r"holds table\.msgpack twice"):
        verified(body + PACK[start:end] + PACK[end:])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({TABLE: b"other"}, r"table\.msgpack is not the file that manifest\.json lists"),
        ({JOB: b"{}"}, r"job\.json is not the file"),
        ({MANIFEST: b"{"}, r"manifest\.json is not JSON"),
        ({MANIFEST: b"{}"}, r"manifest\.json is not the manifest of a pack"),
        ({KEY: b"no key"}, r"public-key\.pem"),
        ({KEY: None}, r"lacks public-key\.pem"),
        ({TABLE: None}, r"lacks table\.msgpack"),
        ({CALIBRATION: None}, r"calibration\.json is not the file"),
    ],
)
def test_verified_inconsistent_signed_members_are_refused(change, words):
    changed = {**verified(PACK).members, **change}
    members = {name: changed[name] for name in MEMBERS if changed.get(name) is not None}
    with pytest.raises(PackError, match=words):
        verified(resealed(members))


def test_verified_changed_manifest_breaks_signature():
    members = dict(verified(PACK).members)
    manifest = json.loads(members[MANIFEST])
    members[MANIFEST] = json.dumps({**manifest, "signer": "eve"}).encode()
    with pytest.raises(PackError, match="signature does not hold"):
        verified(unsigned(members) + PACK[-SIGNATURE_BYTES:])


def test_covering_accepts_only_pack_with_same_bytes_and_key(tmp_path):
    tree, data = tmp_path / "t.msgpack", dumps(small_table())
    (tmp_path / "broken.zip").write_bytes(b"PK")
    with pytest.raises(PackError, match=r"broken\.zip is no zip archive"):
        covering(tree, data, None, SIGNER.public)
    (tmp_path / "a.zip").write_bytes(pack_of(small_table(), SIGNER))
    (tmp_path / "b.zip").write_bytes(pack_of(small_table(), SIGNER, b"{}"))
    assert CALIBRATION not in covering(tree, data, None, SIGNER.public).members
    tree.write_bytes(data)
    (tmp_path / "linked").mkdir()
    (tmp_path / "linked" / "t").symlink_to(tree)
    assert covering(tmp_path / "linked" / "t", data, None, SIGNER.public).members[TABLE] == data
    assert covering(tree, data, b"{}", SIGNER.public).members[CALIBRATION] == b"{}"
    with pytest.raises(PackError, match=r"its calibration\.json is not the one of this run"):
        covering(tree, data, b"{} ", SIGNER.public)
    with pytest.raises(PackError, match=r"its table\.msgpack is not"):
        covering(tree, data + b"x", None, SIGNER.public)
    with pytest.raises(PackError, match="another key"):
        covering(tree, data, None, new_key().public)


def test_covering_relative_path_names_each_pack_once(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("broken.zip").write_bytes(b"PK")
    with pytest.raises(PackError, match="no zip archive") as refused:
        covering(Path("t.msgpack"), b"", None, SIGNER.public)
    assert str(refused.value).count("broken.zip") == 1


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")
def test_pack_signature_of_whole_file_verifies_with_openssl(tmp_path):
    key = public_of(tmp_path / "k.pem")
    key.write_bytes(SIGNER.public.pem)

    def holds(data):
        (tmp_path / "body").write_bytes(data[:-SIGNATURE_BYTES])
        (tmp_path / "signature").write_bytes(data[-SIGNATURE_BYTES:])
        words = ["openssl", "pkeyutl", "-verify", "-rawin", "-pubin", "-inkey", str(key)]
        words += ["-in", str(tmp_path / "body"), "-sigfile", str(tmp_path / "signature")]
        return subprocess.run(words, capture_output=True, timeout=30, check=False).returncode == 0

    assert holds(PACK)
    for at in range(0, len(PACK), len(PACK) // 6):
        changed = bytearray(PACK)
        changed[at] ^= 0x20
        assert not holds(bytes(changed)), at
