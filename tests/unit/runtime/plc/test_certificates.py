"""The server's certificate, and the clients that it admits."""

import stat

import pytest
from refusals import refused_in_a_line
from supervisor import passport

from runtime.plc.certificates import CERTIFICATE, KEY, PINNED, Trust, identity_in
from runtime.shell.errors import InputError, UsageError


@pytest.fixture(scope="module")
def clients(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clients")
    return tuple(passport(folder, name).certificate for name in ("first", "second"))


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("server") / "keys"
    identity_in(folder)
    return folder


@pytest.fixture
def copied(server, tmp_path):
    for name in (KEY, CERTIFICATE):
        (tmp_path / name).write_bytes((server / name).read_bytes())
        (tmp_path / name).chmod(0o600)
    return tmp_path


def test_identity_in_returns_same_certificate_and_owner_only_key(server):
    first, again = identity_in(server), identity_in(server)
    assert again.certificate == first.certificate
    assert first.uri.startswith("urn:")
    assert stat.S_IMODE((server / KEY).stat().st_mode) == 0o600


@pytest.mark.parametrize("name", [KEY, CERTIFICATE])
@pytest.mark.parametrize("content", [b"", b"nonsense", None])
def test_identity_in_damaged_or_missing_file_is_refused_by_name(name, content, copied):
    if content is None:
        (copied / name).unlink()
    else:
        (copied / name).write_bytes(content)
    with refused_in_a_line(InputError, name):
        identity_in(copied)


def test_identity_in_key_of_another_certificate_is_refused(copied, clients):
    (copied / CERTIFICATE).write_bytes(clients[0].read_bytes())
    with pytest.raises(InputError, match="not the key"):
        identity_in(copied)


def test_identity_in_key_readable_by_others_is_refused(copied):
    (copied / KEY).chmod(0o644)
    with pytest.raises(InputError, match="chmod 600"):
        identity_in(copied)


def test_trust_first_client_is_pinned(clients, tmp_path):
    first, second = (path.read_bytes() for path in clients)
    trust = Trust(tmp_path / PINNED, None)
    assert not trust.admits(None)
    assert not (tmp_path / PINNED).exists()
    assert trust.admits(first)
    assert not trust.admits(second)
    later = Trust(tmp_path / PINNED, None)
    assert not later.admits(second)
    assert later.admits(first)


def test_trust_folder_admits_its_certificates_and_pins_no_client(clients, tmp_path):
    first, second = (path.read_bytes() for path in clients)
    (tmp_path / "a.der").write_bytes(first)
    (tmp_path / "notes.txt").write_text("of the line")
    trust = Trust(tmp_path / "elsewhere" / PINNED, tmp_path)
    assert [trust.admits(each) for each in (first, second, None)] == [True, False, False]
    assert not (tmp_path / "elsewhere").exists()


def test_trust_folder_without_certificates_is_refused(tmp_path):
    with pytest.raises(UsageError, match="no certificate"):
        Trust(tmp_path / PINNED, tmp_path)
    (tmp_path / "a.der").write_bytes(b"nonsense")
    with pytest.raises(InputError, match=r"a\.der"):
        Trust(tmp_path / PINNED, tmp_path)
