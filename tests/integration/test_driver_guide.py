"""Drivers as separate packages: the guide's example passes the contract, and broken drivers are refused."""

import os
import re
import sys
import tomllib
from configparser import ConfigParser
from pathlib import Path

import pytest
from programs import ROOT, ended
from refusals import refused_in_a_line

from drivers import connect
from drivers.errors import PortError
from runtime.table import PROFILES, selectable
from runtime.table.grippers import GROUP

EXAMPLE = ROOT / "tools" / "docs" / "other-make"
GUIDE = (ROOT / "tools" / "docs" / "drivers.md").read_text()
BROKEN = {"absent": "no_such_module:gripper", "faulty": "faulty_driver:gripper"}
BROKEN |= dict.fromkeys(("nothing", "twice"), "faulty_driver:nothing")
BROKEN["missing"] = "faulty_driver:missing"
FAULTY = """
def gripper(port, pace, report, *, read_only, profile):
    raise KeyError("in the driver")
def nothing(port, pace, report, *, read_only, profile):
    return object()
"""


def install(folder: Path, name: str, points: dict[str, dict[str, str]]) -> None:
    """Writes the metadata of a package as pip leaves it."""
    path = folder / f"{name}-1.0.dist-info"
    path.mkdir(parents=True)
    (path / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    metadata = ConfigParser()
    metadata.read_dict(points)
    with (path / "entry_points.txt").open("w") as file:
        metadata.write(file)


def test_example_driver_as_installed_package_passes_contract(tmp_path: Path) -> None:
    points = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]["entry-points"]
    assert set(points) == {connect.GRIPPERS.group, connect.ARMS.group, "squeezetree.profiles"}
    install(tmp_path, "other_make", points)
    paths = os.pathsep.join(map(str, (tmp_path, EXAMPLE, ROOT)))
    words = f"-m pytest -q -p no:cacheprovider -c {os.devnull} --rootdir {tmp_path}".split()
    words = [sys.executable, *words, EXAMPLE / "test_other_make.py"]
    done = ended(words, cwd=tmp_path, env={**os.environ, "PYTHONPATH": paths})
    assert re.search(r"^2\d passed in", done.out, re.MULTILINE), done


def test_driver_guide_blocks_are_lines_of_example() -> None:
    blocks = re.findall(r"```(?:python|toml)\n(.*?)```", GUIDE, re.DOTALL)
    sources = "\n".join(path.read_text() for path in EXAMPLE.iterdir() if path.is_file())
    assert len(blocks) >= 3
    for block in blocks:
        for piece in block.strip().split("\n\n...\n\n"):
            assert piece in sources, piece


def test_selectable_includes_sound_profiles_of_installed_drivers_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = {"other-60": "other_make:PROFILE", "unsound": "other_make:QUESTIONS"}
    install(tmp_path, "other_make", {GROUP: points | {"missing": "no_such_module:PROFILE"}})
    monkeypatch.syspath_prepend(EXAMPLE)
    monkeypatch.syspath_prepend(tmp_path)
    assert [*selectable()] == [*PROFILES, "other-60"]


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, "broken", {connect.GRIPPERS.group: BROKEN})
    install(tmp_path, "second", {connect.GRIPPERS.group: {"twice": "faulty_driver:nothing"}})
    (tmp_path / "faulty_driver.py").write_text(FAULTY)
    monkeypatch.syspath_prepend(tmp_path)


@pytest.mark.usefixtures("broken")
@pytest.mark.parametrize(
    ("scheme", "message"),
    [
        ("absent", "(broken, no_such_module:gripper) cannot be loaded: ModuleNotFound"),
        ("missing", "cannot be loaded: AttributeError"),
        ("faulty", "failed to open faulty://x:1: KeyError: 'in the driver'"),
        ("nothing", "opened no Gripper (drivers/ports.py): object"),
        ("twice", "broken and second both have a driver for twice://; uninstall one of them"),
        ("unheard", "is not understood; write it as absent://host:port or "),
    ],
)
def test_connect_broken_driver_is_refused_and_others_still_open(scheme: str, message: str) -> None:
    with refused_in_a_line(PortError, re.escape(message)):
        connect.gripper(f"{scheme}://x:1")
    with pytest.raises(PortError, match="nobody accepts"):
        connect.gripper("tcp://127.0.0.1:1")
