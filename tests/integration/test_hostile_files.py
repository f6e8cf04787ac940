"""No command destroys a file: an input, a device, a pipe, a link, or a file that is not its journal."""

import csv
import os
import stat
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pytest
from programs import JOB, REHEARSAL, VIRTUAL, called, ended
from push_commands import HEADER
from sample_tables import small_table
from written_journals import write_run

from runtime import cli
from runtime.devices.lock import PortLock
from runtime.journal.chain import verify
from runtime.table import dump

SURFACE = (
    "format = 1\nkind = 'ellipsoid'\nrho_mm = 75.0\nellipsoid = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"
)
TEXTS = {
    "poses": "x_mm,y_mm,theta_rad\n1,2,0.3\n",
    "pushes": f"{HEADER},fingers_mm\n15,0,0,1,90,0,2,5\n",
    "log": "no pushes\n",
    "outline": "0,0\n30,0\n30,21\n",
    "expected": "{}\n",
    "view": "a picture\n",
    "touched": "picture,x_mm,y_mm\nview,1,2\n",
}
READ = ("job", "tree", "journal", *TEXTS)


class Command(NamedTuple):
    """A command line.

    Attributes:
        module: the module with its `main`.
        suffix: suffix of the output file.
        words: its arguments; names of `READ` in braces are files that it reads, {out} is the file that it
            writes, {json} and {svg} are {out} with another suffix, {folder} is the folder of {out}.
    """

    module: str
    suffix: str
    words: str


CAMERA = "camera --name S --board charuco:12x9:14:10.5 --views . --table {view} --touched {touched}"
TAG = "tag --part p --number 7 --side 9 --calibration {expected} --poses {touched}"
LISTED = f"""
planner.cli.compile                 .msgpack  {{job}} -o {{out}}
planner.cli.compile                 .msgpack  {{job}} -o {{folder}} --vary seed=1
planner.cli.simulate                .csv      {{job}} --poses {{poses}} -o {{out}}
planner.cli.simulate                .csv      {{job}} --push {{pushes}} -o {{out}}
planner.cli.simulate                .png      {{job}} --poses {{poses}} -o t.csv --figure {{out}}
planner.cli.simulate                .html     {{job}} --poses {{poses}} -o t.csv --html {{out}}
planner.cli.export                  .msgpack  {{tree}} --to json -o {{folder}}
planner.cli.expect                  .json     {{tree}} --job {{job}} -o {{out}}
planner.cli.identify                .toml     {{log}} -o {{out}}
planner.cli.identify                .svg      {{log}} --figure {{out}}
planner.cli.init                    .csv      {{outline}} --force -o {{out}}
planner.cli.first_look              .csv      {{outline}} --units mm -o {{out}}
planner.cli.refit                   .toml     {{job}} --journal {{journal}} -o {{out}}
planner.cli.report                  .html     {{tree}} --job {{job}} --journal {{journal}} -o {{out}}
runtime.commands.journal            .csv      export {{journal}} -o {{out}}
runtime.commands.evidence           .zip      pack {{tree}} -o {{out}}
runtime.spc.command                 .html     {{journal}} --expected {{expected}} -o {{out}}
runtime.spc.command                 .csv      {{journal}} --export {{out}}
drivers.camera.calibration.command  .json     {TAG} -o {{out}}
drivers.camera.calibration.command  .json     {CAMERA} -o {{out}}
drivers.camera.calibration.command  .svg      {CAMERA} -o {{json}}
"""
COMMANDS = [Command(*line.split(None, 2)) for line in LISTED.strip().splitlines()]
CLASHES = [(each, read) for each in COMMANDS for read in READ if f"{{{read}}}" in each.words]


def named(value: object) -> str:
    """The test id of an argument."""
    return str(value) if isinstance(value, str) else f"{value.module} {value.words}"


class Desk:
    """A folder with an input of each kind.

    Attributes:
        folder: the folder.
        files: the inputs by their names in `READ`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.files = folder, {name: folder / name for name in READ}
        self.files["job"].write_bytes(JOB.read_bytes())
        dump(small_table(), self.files["tree"])
        write_run(self.files["journal"])
        for name, text in TEXTS.items():
            self.files[name].write_text(text)

    def run(self, command: Command, out: Path) -> int:
        """Runs a command that reads the desk's files and writes to `out`; returns its exit code."""
        names = {kind: out.with_suffix(f".{kind}") for kind in ("json", "svg")}
        names |= {"out": out, "folder": out.parent, **self.files}
        words = [word.format(**names) for word in command.words.split()]
        return int(import_module(command.module).main(words))

    def start(self, journal: Path) -> int:
        """Runs a part in a simulated cell; returns the exit code."""
        words = ["--tree", str(self.files["tree"]), "--journal", str(journal)]
        return cli.main([*words, *VIRTUAL, *REHEARSAL])

    def seen(self) -> dict[str, object]:
        """What lies in the folder, by path: content of files, target of links, or kind and device."""
        return {str(path): what_is(path) for path in self.folder.rglob("*")}


def what_is(path: Path) -> object:
    status = path.lstat()
    if stat.S_ISLNK(status.st_mode):
        return path.readlink()
    return path.read_bytes() if stat.S_ISREG(status.st_mode) else (status.st_mode, status.st_rdev)


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Desk:
    monkeypatch.chdir(tmp_path)
    return Desk(tmp_path)


@pytest.fixture
def refuses(desk: Desk, capfd: pytest.CaptureFixture[str]) -> Callable[[Command, Path], int]:
    """Returns a check: a command refuses to write to a path, by a message of one line, and changes no file.

    The check returns the command's exit code.
    """

    def check(command: Command, out: Path) -> int:
        before = desk.seen()
        code = desk.run(command, out)
        said = capfd.readouterr()
        assert said.err.count("\n") == 1, said
        assert "name another" in said.err
        assert "Traceback" not in said.err
        assert desk.seen() == before
        return code

    return check


def odd_files(folder: Path, suffix: str) -> dict[str, Path]:
    """Paths that no output may have, each in a separate folder; a device only if the test runs as root."""
    kinds = ["pipe", "folder", "link", "dangling link", "socket"]
    kinds += ["device"] if os.geteuid() == 0 else []
    record = {kind: folder / kind / f"seed=1{suffix}" for kind in kinds}
    for path in record.values():
        path.parent.mkdir()
    (folder / "precious").write_text("precious\n")
    os.mkfifo(record["pipe"])
    record["folder"].mkdir()
    record["link"].symlink_to(folder / "precious")
    record["dangling link"].symlink_to(folder / "nowhere")
    os.mknod(record["socket"], stat.S_IFSOCK | 0o600)
    if "device" in record:
        os.mknod(record["device"], stat.S_IFCHR | 0o666, os.makedev(1, 3))
    return record


@pytest.mark.parametrize(("command", "read"), CLASHES, ids=named)
def test_command_output_that_is_an_input_is_refused(desk, refuses, command, read):
    out = desk.files[read].rename(desk.folder / f"seed=1{command.suffix}")
    desk.files[read] = out
    other = desk.folder / "other" / out.name
    other.parent.mkdir()
    codes = {refuses(command, out), refuses(command, other.parent / ".." / out.name)}
    other.symlink_to(out)
    codes.add(refuses(command, other))
    other.unlink()
    other.hardlink_to(out)
    codes.add(refuses(command, other))
    assert codes == {2}


@pytest.mark.parametrize("command", COMMANDS, ids=named)
def test_command_output_that_is_no_regular_file_is_refused(desk, refuses, command):
    odd = odd_files(desk.folder, command.suffix)
    codes = {refuses(command, path) for path in odd.values()}
    assert codes == {2}
    if "device" not in odd:
        pytest.skip("all but the device, which only root can make")


def test_command_output_named_by_job_or_named_twice_is_refused(desk, refuses):
    """An output may be neither the surface file that the job names, nor the file of another output."""
    surface = desk.folder / "surface.msgpack"
    surface.write_text(SURFACE)
    stated = 'kind = "boundary"'
    text = desk.files["job"].read_text()
    assert stated in text
    stated_by = 'kind = "identified"\nsurface_file = "surface.msgpack"'
    desk.files["job"].write_text(text.replace(stated, stated_by))
    refuses(COMMANDS[0], surface)
    twice = Command("planner.cli.simulate", ".svg", "{job} --poses {poses} -o {out} --figure {out}")
    refuses(twice, desk.folder / "s.svg")


@pytest.mark.parametrize("kind", ["text", "json", "tree", "another journal", "no end", "odd"])
def test_grasp_runtime_journal_path_of_other_file_is_not_written(desk, capfd, kind):
    contents = {
        "text": b"a note\nand one more, without an end",
        "json": b'{"host": "cell"}',
        "tree": desk.files["tree"].read_bytes(),
        "another journal": b'{"seq":0,"time":"now","kind":"header"}\n{"seq":1,"time":"now"',
        "no end": b"x" * 100,
    }
    if kind == "odd":
        paths = list(odd_files(desk.folder, ".jsonl").values())
    else:
        paths = [desk.folder / kind]
        paths[0].write_bytes(contents[kind])
    for path in paths:
        before = desk.seen()
        assert desk.start(path) == 24
        said = capfd.readouterr().err.splitlines()
        assert said[-1].startswith(f"grasp-runtime: journal {path}")
        assert "is no" in said[-1] or "it is a" in said[-1] or kind == "another journal"
        assert desk.seen() == before


def test_journal_with_torn_last_line_continues_if_number_follows(desk: Desk) -> None:
    path = desk.files["journal"]
    whole = path.read_bytes()
    path.write_bytes(whole + b'{"seq":99')
    assert desk.start(path) == 24
    assert path.read_bytes() == whole + b'{"seq":99'
    number = whole.count(b"\n")
    path.write_bytes(whole + b'{"seq":%d,"time' % number)
    code = desk.start(path)
    assert code in (0, 10)
    assert path.read_bytes().startswith(whole)
    assert verify(path).runs == 2


def test_calibrate_width_irregular_output_is_refused_before_port_opens(desk: Desk) -> None:
    for path in odd_files(desk.folder, ".json").values():
        before = desk.seen()
        words = ("width", "--port", "/dev/none", "--gripper", "S", "-o", path)
        code, _, err = called(cli.calibrate, *words)
        assert code == 2
        assert "cannot be written: " in err
        assert desk.seen() == before


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("grasp-journal", "export {journal} -o /dev/stdout"),
        ("plan-simulate", "{job} --poses {poses} --nominal --mu 0.5 -o /dev/stdout"),
    ],
)
def test_export_and_simulate_to_stdout_print_only_rows(
    desk: Desk, program: str, words: str
) -> None:
    """The output is named by the link /dev/stdout, which must not be replaced."""
    before = what_is(Path("/dev/stdout"))
    command = [Path(sys.executable).with_name(program), *words.format(**desk.files).split()]
    code, out, err = ended(command, timeout=250)
    assert code == 0, err
    rows = list(csv.reader(out.splitlines()))
    assert len(rows) > 1
    assert {len(row) for row in rows} == {len(rows[0])}
    assert err.count("\n") == 1
    assert what_is(Path("/dev/stdout")) == before


def test_port_lock_other_name_of_locked_port_is_refused(desk, monkeypatch, capfd):
    """The lock depends neither on XDG_RUNTIME_DIR, nor on the files in that folder."""
    number = 10_000 + os.getpid() % 50_000
    with PortLock(f"tcp://127.0.0.1:{number}"):
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(desk.folder))
        words = ["--tree", str(desk.files["tree"]), "--arm", "tcp://127.0.0.1:9"]
        words += ["--journal", "j.jsonl"]
        before = desk.seen()
        for port in (f"tcp://localhost:{number}", f"rtu+tcp://127.0.0.1:{number}"):
            assert cli.main([*words, "--port", port]) == 21
            assert f"process {os.getpid()}" in capfd.readouterr().err
        assert desk.seen() == before
