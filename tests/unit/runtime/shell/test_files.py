"""Writing a file: completely or not at all, never through a planted link, with the mode of the old file."""

import os
import shlex
from pathlib import Path

import pytest

from runtime.shell import files
from runtime.shell.files import OutputError, read_regular, usable, writing


@pytest.mark.parametrize("mode", [None, 0o600, 0o640, 0o666, 0o444 | 0o200])
def test_writing_keeps_mode_of_replaced_file(tmp_path, mode):
    """A private file stays private from its first byte on; a new file has the mode that the umask leaves."""
    path = tmp_path / "t.json"
    if mode is not None:
        path.write_text("old")
        path.chmod(mode)
    before = os.umask(0o027)
    try:
        with writing(path) as draft:
            drafted = draft.stat().st_mode & 0o777
            assert draft.suffix == path.suffix  # some writers choose the format by it
            draft.write_text("new")
    finally:
        os.umask(before)
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == drafted == (0o640 if mode is None else mode)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "name", ["a b.toml", "a'b.toml", "$(rm x).toml", "-o.toml", "plain.toml", "a;b", "ü"]
)
def test_quoted_name_is_one_shell_word_and_no_option(name):
    (word,) = shlex.split(files.quoted(Path(name)))
    assert Path(word) == Path(name)
    assert not word.startswith("-")
    assert files.quoted("plain.toml") == "plain.toml"


@pytest.mark.parametrize(
    "error", [OSError(28, "disk full"), ValueError("bug"), KeyboardInterrupt("stop")]
)
def test_writing_interrupted_keeps_old_file_and_leaves_no_draft(tmp_path, error):
    def break_off():
        with writing(path) as draft:
            draft.write_text("half")
            raise error

    path = tmp_path / "t.json"
    path.write_text("old")
    with pytest.raises(type(error), match=r"t.json cannot be written: disk full; free|bug|stop"):
        break_off()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("size", [0, 1023, 1024])
def test_read_regular_file_within_the_limit_is_whole(tmp_path, size):
    path = tmp_path / "data"
    path.write_bytes(bytes(size))
    data, mode = read_regular(path, 1024)
    assert data == bytes(size)
    assert mode == path.stat().st_mode


@pytest.mark.parametrize(
    ("most_bytes", "limit"), [(1 << 10, "1 KiB"), (1536 << 10, "1536 KiB"), (3 << 20, "3 MiB")]
)
def test_read_regular_file_beyond_the_limit_is_refused_not_cut(tmp_path, most_bytes, limit):
    path = tmp_path / "data"
    path.write_bytes(bytes(most_bytes + 1))
    with pytest.raises(OSError, match=f"larger than {limit}"):
        read_regular(path, most_bytes)


def test_writing_brings_draft_to_disk_before_it_replaces_file(tmp_path, monkeypatch):
    path, seen = tmp_path / "t.json", []
    path.write_text("old")
    monkeypatch.setattr(
        files, "bring_to_disk", lambda draft: seen.extend([draft.read_text(), path.read_text()])
    )
    with writing(path) as draft:
        draft.write_text("new")
    assert seen == ["new", "old"]


def test_writing_planted_link_is_not_followed(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "urandom", lambda count: bytes(count))
    victim, link = tmp_path / "victim", tmp_path / ".t.00000000.json"
    victim.write_text("precious")
    link.symlink_to(victim)
    with pytest.raises(OutputError, match="File exists"), writing(tmp_path / "t.json"):
        pass
    assert victim.read_text() == "precious"
    assert link.readlink() == victim
    assert not (tmp_path / "t.json").exists()


def test_writing_fifo_put_in_place_meanwhile_is_not_replaced(tmp_path):
    def meanwhile():
        with writing(path):
            os.mkfifo(path)

    path = tmp_path / "t.json"
    with pytest.raises(OutputError, match="it is no regular file"):
        meanwhile()
    assert path.is_fifo()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none/t.csv", "there is no folder"),
        ("file/t.csv", "there is no folder"),
        ("x" * 300, "File name too long"),
        ("", "it is a folder"),
        ("./file", "it is the same file as"),
        ("new/../yet to be", "it is the same file as"),
    ],
)
def test_usable_unwritable_path_is_refused(tmp_path, name, message):
    (tmp_path / "file").touch()
    (tmp_path / "new").mkdir()
    others = (None, tmp_path / "file", tmp_path / "yet to be")
    with pytest.raises(OutputError, match=f"{message}.*; name another file$"):
        usable(tmp_path / name if name else tmp_path, *others)
