"""Evidence packs: creating, verifying and requiring them, and the log of installed tables."""

import json
import os
import resource
import shutil
import signal

import pytest
from asking_robots import Line, Served
from calibrations import linear
from documents import DOCS, blocks, matches, run, shims
from programs import REHEARSAL, TABLE, VIRTUAL, called
from sample_tables import several_table, small_table

from runtime import cli
from runtime.commands.evidence import main
from runtime.journal.chain import records, verify
from runtime.table import dump


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A folder with a table, a pair of keys and a signed pack; nothing is read or written elsewhere."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    dump(small_table(), tmp_path / "t.msgpack")
    assert main(["key", "-o", "k.pem"]) == 0
    assert main(["pack", "t.msgpack", "-o", "p.zip", "--key", "k.pem", "--signer", "Ada"]) == 0
    return tmp_path


def verified(*words):
    code, out, err = called(main, "verify", "p.zip", *words)
    assert code == 0, err
    return out


def test_verify_states_signer_and_whether_key_was_checked(desk):
    assert "signed with k.pem.pub by Ada" in verified("--key", "k.pem.pub")
    assert "signed by Ada" in (said := verified())
    assert "was not checked against anyone" in said
    record = json.loads(verified("--json"))
    assert record["checked_against"] is None
    assert record["signer"] == "Ada"
    assert set(record["versions"]) >= {"squeezetree", "python", "msgpack"}


def test_pack_without_key_creates_one_once(desk, capsys):
    assert main(["pack", "t.msgpack", "-o", "q.zip"]) == 0
    path = desk / "config" / "squeezetree" / "signing-key.pem"
    assert path.stat().st_mode & 0o777 == 0o600
    assert "made a key to sign with" in capsys.readouterr().err
    before = path.read_bytes()
    assert main(["pack", "t.msgpack", "-o", "r.zip"]) == 0
    assert path.read_bytes() == before
    assert main(["verify", "r.zip", "--key", f"{path}.pub"]) == 0
    assert main(["key"]) == 2


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        ("verify none.zip", 3, "cannot be read"),
        ("verify .", 3, "it is a folder"),
        ("verify t.msgpack", 34, "is no zip archive"),
        ("verify k.pem", 34, "is no zip archive"),
        ("verify p.zip --key none.pub", 3, "cannot be read"),
        ("verify p.zip --key k.pem", 3, "name the public one"),
        ("verify p.zip --key t.msgpack", 3, "holds no public key"),
        ("pack none.msgpack -o q.zip --key k.pem", 3, "none.msgpack"),
        ("pack p.zip -o q.zip --key k.pem", 3, "table p.zip"),
        ("pack t.msgpack -o p.zip --key k.pem", 2, "never overwritten"),
        ("pack t.msgpack -o t.msgpack --key k.pem", 2, "the same file"),
        ("pack t.msgpack -o k.pem --key k.pem", 2, "the same file"),
        ("pack t.msgpack -o none/q.zip --key k.pem", 2, "no folder"),
        ("pack t.msgpack -o q.zip --key none.pem", 3, "squeezetree key makes one"),
        ("pack t.msgpack -o q.zip --key k.pem.pub", 3, "name the private one"),
        ("pack t.msgpack -o q.zip --key k.pem --calibration k.pem", 3, "calibration k.pem"),
        ("key -o k.pem", 2, "never overwritten"),
        ("key -o none/k.pem", 2, "no folder"),
    ],
)
def test_grasp_evidence_bad_input_is_refused_in_one_line_with_its_code(desk, words, code, says):
    before = sorted(path.name for path in desk.iterdir())
    is_refused(main, words, code, says)
    assert sorted(path.name for path in desk.iterdir()) == before


def is_refused(program, words, code, says):
    ended = called(program, *words.split())
    assert (ended.code, ended.one_line) == (code, True), ended
    assert says in ended.err


def test_verify_changed_pack_exits_34_and_names_file(desk):
    data = bytearray((desk / "p.zip").read_bytes())
    data[data.index((desk / "t.msgpack").read_bytes()) + 100] ^= 1
    (desk / "p.zip").write_bytes(data)
    says = "pack p.zip: table.msgpack was changed"
    is_refused(main, "verify p.zip --key k.pem.pub", 34, says)


def test_pack_and_key_on_full_disk_leave_no_file(desk, capsys):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    before, ignored = sorted(desk.iterdir()), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    capsys.readouterr()
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, limits[1]))
    try:
        assert main(["pack", "t.msgpack", "-o", "q.zip", "--key", "k.pem"]) == 2
        assert main(["key", "-o", "l.pem"]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    assert capsys.readouterr().err.count("cannot be written") == 2
    assert sorted(desk.iterdir()) == before


def test_require_signed_table_without_valid_signature_is_refused(desk):
    check = "--tree t.msgpack --check --require-signed"
    assert cli.main([*check.split(), "k.pem.pub"]) == 0
    assert main(["key", "-o", "other.pem"]) == 0
    is_refused(cli.main, f"{check} other.pem.pub", 34, "p.zip is signed by another key")
    is_refused(cli.main, f"{check} none.pub", 3, "none.pub")
    dump(several_table(), desk / "t.msgpack")
    says = "its table.msgpack is not the one of this run"
    is_refused(cli.main, f"{check} k.pem.pub", 34, says)
    (desk / "p.zip").unlink()
    run = " ".join(["--tree t.msgpack --journal j.jsonl", *VIRTUAL, *REHEARSAL])
    is_refused(cli.main, f"{run} --require-signed k.pem.pub", 34, "there is no pack beside it")
    assert not list(desk.glob("j.jsonl*"))


def test_installed_log_records_each_change_of_table_or_signer(desk):
    def code_of(*more):
        words = ("--tree", "t.msgpack", "--journal", "j.jsonl", *VIRTUAL, *REHEARSAL)
        return cli.main([*words, *more])

    assert code_of("--require-signed", "k.pem.pub") in (0, 10)
    assert code_of("--require-signed", "k.pem.pub") in (0, 10)
    assert code_of() in (0, 10)
    dump(several_table(), desk / "t.msgpack")
    assert code_of() in (0, 10)
    log = desk / "j.jsonl.installed"
    assert verify(log).closed
    headers = [entry for entry in records(log) if entry["kind"] == "header"]
    assert [entry["signer"] for entry in headers] == ["Ada", None, None]
    assert len({entry["table_sha256"] for entry in headers}) == 2
    log.write_bytes(log.read_bytes().replace(b'"Ada"', b'"Eve"'))
    assert code_of() == 24


def test_serve_with_replaced_table_file_keeps_loaded_table(desk):
    with Served(desk / "t.msgpack") as served, Line(served) as line:
        line.send(b"TABLE\n")
        before = line.read()
        dump(several_table(), desk / "t.msgpack")
        line.send(b"TABLE\n")
        assert line.read() == before


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")
def test_evidence_page_commands_print_shown_output(tmp_path, work):
    shutil.copyfile(TABLE, work / "lever.msgpack")
    linear(work / "gripper.json")
    environment = {**os.environ, "PATH": f"{shims(tmp_path / 'bin')}:{os.environ['PATH']}"}
    result = blocks(DOCS / "evidence.md")
    for block, printed in zip(result, run(result, work, environment), strict=False):
        assert matches(block.printed, printed)
