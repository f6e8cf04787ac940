"""A project folder: names from a page reach only its files, and nothing is overwritten."""

import pytest

from planner.studio.folder import Folder, checked
from runtime.shell.errors import UsageError


@pytest.fixture
def folder(plate):
    return Folder(plate.parent)


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".",
        "..",
        ".hidden",
        "a/b",
        "../a",
        "a\\b",
        "a\nb",
        "a\0b",
        "x" * 121,
        "\u4e09" * 78,
        None,
        7,
    ],
)
def test_checked_invalid_name_is_refused(name):
    with pytest.raises(UsageError):
        checked(name)


def test_add_drawing_of_a_taken_name_overwrites_nothing(folder):
    assert folder.add("plate.csv", b"other") == "plate-2.csv"
    assert folder.add("plate.csv", b"other") == "plate-2.csv"
    assert folder.add("plate.csv", b"third") == "plate-3.csv"
    assert (folder.path / "plate.csv").read_text().startswith("0,0")
    names = {path.name for path in folder.path.iterdir()}
    assert names == {f"plate{number}.csv" for number in ("", "-2", "-3")}


def test_folder_links_hidden_files_and_folders_are_left_out(folder, tmp_path):
    (tmp_path / "link.csv").symlink_to("/etc/hostname")
    (tmp_path / ".secret").write_text("s")
    (tmp_path / "inner").mkdir()
    assert [file.name for file in folder.files()] == ["plate.csv"]
    with pytest.raises(UsageError):
        folder.read("link.csv", 100)
    with pytest.raises(OSError, match="folder"):
        folder.read("inner", 100)
