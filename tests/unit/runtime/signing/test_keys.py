"""Key files: private, never overwritten, in OpenSSL's form; an invalid one is refused in a sentence."""

import os
import shutil
import subprocess

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa

from runtime.shell.errors import InputError
from runtime.shell.files import OutputError
from runtime.signing import keys

PEM, PKCS8 = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
PUBLIC = serialization.PublicFormat.SubjectPublicKeyInfo
PLAIN = serialization.NoEncryption()


def test_generate_with_open_umask_writes_owner_only_key(tmp_path):
    path = tmp_path / "k.pem"
    before = os.umask(0)
    try:
        result = keys.generate(path)
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o600
    assert keys.load_private(path).public == result.public == keys.load_public(keys.public_of(path))
    signature = result.sign(b"data")
    assert result.public.signed(b"data", signature)
    assert not result.public.signed(b"date", signature)


@pytest.mark.parametrize("there", ["k.pem", "k.pem.pub"])
def test_generate_existing_file_is_kept_and_nothing_added(tmp_path, there):
    (tmp_path / there).write_text("precious")
    with pytest.raises(OutputError, match="never overwritten"):
        keys.generate(tmp_path / "k.pem")
    assert [path.name for path in tmp_path.iterdir()] == [there]
    assert (tmp_path / there).read_text() == "precious"


def test_generate_through_a_link_is_refused(tmp_path):
    (tmp_path / "k.pem").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError):
        keys.generate(tmp_path / "k.pem")
    assert not (tmp_path / "elsewhere").exists()


def test_load_private_readable_by_others_is_refused(tmp_path):
    keys.generate(tmp_path / "k.pem")
    (tmp_path / "k.pem").chmod(0o640)
    with pytest.raises(InputError, match="chmod 600"):
        keys.load_private(tmp_path / "k.pem")


def _write(path, data):
    path.write_bytes(data)
    path.chmod(0o600)
    return path


KINDS = [(rsa.generate_private_key(65537, 1024), "an RSA key")]
KINDS += [(ec.generate_private_key(ec.SECP256R1()), "an EC key")]


@pytest.mark.parametrize(("key", "words"), KINDS)
def test_load_key_of_another_kind_is_refused_by_name(tmp_path, key, words):
    private = _write(tmp_path / "k", key.private_bytes(PEM, PKCS8, PLAIN))
    public = _write(tmp_path / "p", key.public_key().public_bytes(PEM, PUBLIC))
    with pytest.raises(InputError, match=f"holds .*{words}"):
        keys.load_private(private)
    with pytest.raises(InputError, match=f"holds .*{words}"):
        keys.load_public(public)


def test_load_private_key_with_passphrase_is_refused(tmp_path):
    result = ed25519.Ed25519PrivateKey.generate()
    locked = result.private_bytes(PEM, PKCS8, serialization.BestAvailableEncryption(b"x"))
    with pytest.raises(InputError, match="passphrase"):
        keys.load_private(_write(tmp_path / "locked", locked))


def test_load_other_half_of_key_pair_is_refused(tmp_path):
    keys.generate(tmp_path / "k")
    with pytest.raises(InputError, match="holds a public key; name the private one"):
        keys.load_private(tmp_path / "k.pub")
    with pytest.raises(InputError, match=r"holds a private key; name the public one, k\.pub"):
        keys.load_public(tmp_path / "k")


@pytest.mark.parametrize(
    "data",
    [b"", b"\0" * 100, b"-----BEGIN PUBLIC KEY-----\nAAAA\n-----END PUBLIC KEY-----\n"],
    ids=["empty", "zeros", "short"],
)
def test_load_public_data_without_key_is_refused(tmp_path, data):
    with pytest.raises(InputError, match="no public key"):
        keys.load_public(_write(tmp_path / "odd", data))


@pytest.mark.parametrize("name", ["none", "", "pipe"], ids=["missing", "folder", "pipe"])
def test_load_public_unreadable_path_is_refused(tmp_path, name):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="cannot be read"):
        keys.load_public(tmp_path / name)


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")
def test_keys_are_interchangeable_with_openssl(tmp_path):
    def openssl(*words):
        command = ["openssl", *map(str, words)]
        return subprocess.run(command, capture_output=True, timeout=30, check=True).stdout

    theirs, public = tmp_path / "theirs.pem", tmp_path / "theirs.pub"
    openssl("genpkey", "-algorithm", "ed25519", "-out", str(theirs))
    theirs.chmod(0o600)
    openssl("pkey", "-in", str(theirs), "-pubout", "-out", str(public))
    loaded = keys.load_private(theirs)
    assert loaded.public == keys.load_public(public)
    assert loaded.public.pem == public.read_bytes()
    der = openssl("pkey", "-pubin", "-in", str(public), "-outform", "DER")
    assert der == keys._PREFIX + loaded.public.raw
