"""A calibration passes through its gauge blocks, is monotonic, beats the linear map; its file is checked."""

import io
import json
from collections.abc import Iterator
from dataclasses import replace
from math import acos
from pathlib import Path
from types import SimpleNamespace

import pytest
from fake_cell import FakeGripper, Log, State
from sample_tables import GRIPPER

from drivers.ports import GripperState, ObjectState, Settled
from runtime.commands.calibrate import figures, measured, parser, report, run
from runtime.errors import GripperStateError
from runtime.execution import calibration
from runtime.execution.calibration import Gauge, fit, load, residuals_mm, save
from runtime.shell import strict_json
from runtime.shell.errors import InputError, UsageError
from runtime.shell.files import OutputError
from runtime.table import PROFILES, Calibration

BLOCKS = (0.0, 5.0, 10.0, 20.0, 40.0, 60.0, 80.0)
LINK_MM, OFFSET_MM = 57.15, 5.0


def count_of(width_mm: float) -> float:
    """The count of a gripper at an opening, linear in the angle of its finger links.

    The opening therefore follows an arc, at worst 2.9 mm off the linear map.
    """

    def angle(width: float) -> float:
        return acos((width / 2 - OFFSET_MM) / LINK_MM)

    return 3 + 227 * (angle(width_mm) - angle(85.0)) / (angle(0.0) - angle(85.0))


PROFILE = GRIPPER.profile


def read_um(count: float) -> int:
    return PROFILE.counted_um(round(count))


def gauges(widths: tuple[float, ...] = BLOCKS) -> list[Gauge]:
    return [Gauge(width, (read_um(count_of(width)),) * 3) for width in widths]


def fitted_to(measured: list[Gauge]) -> calibration.GripperCalibration:
    return fit(measured, PROFILE, "S/N 1", "today")


def test_fit_passes_through_the_blocks_and_never_falls():
    calibration = fitted_to(gauges())
    widths = [true for _, true in calibration.points_um]
    assert widths == sorted(widths)
    table = calibration.of(PROFILE)
    for gauge in calibration.gauges:  # the table is linear between points of the fitted curve
        assert abs(table.width_um(round(gauge.mean)) - 1000 * gauge.width_mm) <= 20
    assert table.width_um(-9_000) == 0


def test_calibration_of_jaws_with_another_stroke_is_refused():
    wide = fit(gauges(), PROFILES["robotiq-2f-140"], "S/N 2", "today")
    with pytest.raises(InputError, match=r"S/N 2.* opens 140 mm, a robotiq-2f-85 85 mm"):
        wide.of(PROFILES["robotiq-2f-85"])
    narrowed = replace(PROFILES["robotiq-2f-85"], stroke_um=50_000)  # a job may open the jaws less
    assert fitted_to(gauges()).of(narrowed).points_um


def test_fit_of_seven_blocks_is_within_half_a_millimetre():
    fitted, linear = fitted_to(gauges()), Calibration(PROFILE)
    table, widths = fitted.of(PROFILE), [w / 4 for w in range(4, 330)]
    ours = max(abs(table.width_um(read_um(count_of(w))) / 1000 - w) for w in widths)
    line = max(abs(linear.width_um(read_um(count_of(w))) / 1000 - w) for w in widths)
    assert ours < 0.5  # rounding of block and reading to counts takes 0.2 of it
    assert line > 2.5
    assert max(map(abs, residuals_mm(fitted))) < 1.0
    off = [block["off_nominal_mm"] for block in figures(fitted)["blocks"]]
    assert len(off) == len(BLOCKS)
    assert max(map(abs, off)) > 2.0


@pytest.mark.parametrize(
    ("measured", "message"),
    [
        (gauges((0.0, 5.0)), "2 gauge blocks"),
        ([*gauges(), Gauge(20.0, (22_000,))], "of different widths"),
        ([*gauges((0.0, 5.0)), Gauge(20.0, (4_000,))], "a wider one reads more"),
    ],
)
def test_fit_few_or_contradictory_measurements_are_refused(measured, message):
    with pytest.raises(InputError, match=message):
        fitted_to(measured)


def test_load_returns_saved_file_and_refuses_changed_value(tmp_path):
    path = tmp_path / "g.json"
    for tips, current in ((None, None), ((57.15, 5.2), (30, 900))):
        fitted = replace(fitted_to(gauges()), tips_mm=tips, current_ma=current)
        save(fitted, path)
        assert load(path).calibration == fitted
    record = json.loads(path.read_text())
    record["points_um"][30][1] += 1
    path.write_text(json.dumps(record))
    with pytest.raises(InputError, match="changed after it was measured"):
        load(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"{", "not JSON"), (b"\xff", "JSON"), (b"[]", "of format 2"), (b'{"format": 1}', "format 2")],
)
def test_load_invalid_file_is_refused(tmp_path, content, message):
    path = tmp_path / "g.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        load(path)


def test_load_missing_file_and_save_in_missing_folder_are_refused(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        load(tmp_path / "none.json")
    with pytest.raises(OutputError, match="name another file"):
        save(fitted_to(gauges()), tmp_path / "none" / "g.json")


def test_load_falling_points_with_valid_digest_are_refused(tmp_path):
    path = tmp_path / "g.json"
    save(fitted_to(gauges()), path)
    record = json.loads(path.read_text())
    del record["sha256"]
    record["points_um"] = record["points_um"][::-1]
    record["sha256"] = strict_json.digest(record)
    path.write_text(json.dumps(record))
    with pytest.raises(InputError, match="must rise with what is read"):
        load(path)


# -- grasp-calibrate ------------------------------------------------------------------------------


class ArcGripper(FakeGripper):
    """A gripper, not active at first, that closes on the block that the command asks a person to hold."""

    def __init__(self) -> None:
        super().__init__(Log(), self.stops())
        self.now, self.block_mm = State(activated=False), 0.0

    def stops(self) -> Iterator[tuple[int, int]]:
        while True:
            yield round(count_of(self.block_mm)), 2 if self.block_mm > 0.0 else 3

    def hold(self, sentence: str) -> None:
        words = sentence.split()
        if words[0] in ("Hold", "Take"):
            self.block_mm = float(words[2]) if words[0] == "Hold" else 0.0


def drivers(gripper: ArcGripper) -> SimpleNamespace:
    return SimpleNamespace(gripper=lambda port, profile: gripper)


def arguments(tmp_path: Path, *more: str):
    words = ["width", "--port", f"tcp://calibrate{tmp_path.name}:1", "--gripper", "S/N 7"]
    return parser().parse_args([*words, "-o", str(tmp_path / "g.json"), *more])


def test_calibrate_grips_each_block_gently_and_writes_the_file(tmp_path, capsys):
    gripper = ArcGripper()
    given = arguments(tmp_path, "--activate", "--tips", "57.15,5.3", "--current", "0,800")
    assert run(given, drivers(gripper), gripper.hold) == 0
    calibration = load(tmp_path / "g.json").calibration
    assert [gauge.width_mm for gauge in calibration.gauges] == list(BLOCKS)
    assert calibration.gauges == tuple(gauges())
    assert (calibration.tips_mm, calibration.current_ma) == ((57.15, 5.3), (0, 800))
    assert calibration.gripper == "S/N 7"
    moves = [call.arguments for call in gripper.log.named("move")]
    assert {force for _, _, force in moves} == {0}
    assert {speed for position, speed, _ in moves if position == 255} == {0}
    assert gripper.log.named("close")
    out = capsys.readouterr().out
    assert "nominal" in out
    assert len(list(report(figures(calibration)))) == 2 + len(BLOCKS)


def test_calibrate_inactive_gripper_or_missing_block_writes_no_file(tmp_path):
    gripper = ArcGripper()
    with pytest.raises(GripperStateError, match="not activated"):
        run(arguments(tmp_path), drivers(gripper), gripper.hold)
    gripper.activate()
    with pytest.raises(GripperStateError, match="without meeting the 5 mm block"):
        run(arguments(tmp_path), drivers(gripper), lambda sentence: None)
    assert not (tmp_path / "g.json").exists()


@pytest.mark.parametrize(
    ("held", "more", "said"),
    [(True, [], "stand at 20.97 mm and hold something"), (False, ["--activate"], "press Enter")],
    ids=["something is held", "to be activated"],
)
def test_calibrate_without_a_terminal_moves_nothing(
    tmp_path, monkeypatch, capsys, held, more, said
):
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    gripper = ArcGripper()
    if held:
        gripper.now = State(object_flag=2, echo_counts=255, position_counts=174)
    with pytest.raises(UsageError, match="run it in a terminal"):
        measured(arguments(tmp_path, *more), SimpleNamespace(gripper=lambda port, profile: gripper))
    assert said in capsys.readouterr().out
    assert (gripper.now.activated, gripper.log.named("move")) == (held, [])
    assert gripper.log.named("close")


@pytest.mark.parametrize(
    "wrong",
    [
        *(f"--blocks={blocks}" for blocks in ("1,two", "-1,2,3", "0,5,nan", "0,inf,5", "0,10")),
        *("--blocks=0,10,10", "--grips=0", "--tips=1,2,3", "--current=800", "--output=none/g.json"),
        *("--blocks=0,5,100", "--tips=5,9", "--current=500,100", "--gripper=x\ny", "--gripper="),
    ],
)
def test_calibrate_wrong_arguments_are_refused_before_opening(tmp_path, wrong):
    def opened(port, profile):
        raise AssertionError("the gripper was opened")

    with pytest.raises(UsageError, match=f"{wrong.partition('=')[0]}|cannot be written"):
        measured(arguments(tmp_path, wrong), SimpleNamespace(gripper=opened))
    assert not list(tmp_path.iterdir())


class Empty:
    """A gripper with nothing between its fingers, which notes how long its strokes take."""

    def __init__(self, profile):
        self.profile, self.at_um, self.seconds = profile, profile.stroke_um, 0.0

    def state(self):
        at_um = self.at_um
        return GripperState(True, False, 0, "", ObjectState.AT_TARGET, at_um, at_um, 0)

    def move(self, width_um, speed_mm_s, force_n):
        least, most = self.profile.speed_mm_s
        assert least <= speed_mm_s <= most
        self.asked_um, width_um = width_um, max(width_um, 0)
        self.seconds = abs(width_um - self.at_um) / 1000 / speed_mm_s
        self.at_um = width_um
        assert self.seconds < 10.0

    def wait(self):
        return Settled(self.at_um, ObjectState.AT_TARGET, 0, self.asked_um, self.seconds)


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES.keys())
def test_measure_stroke_of_any_profile_takes_under_ten_seconds(profile):
    (gauge,) = calibration.measure(Empty(profile), [0.0], 3, lambda _: None)
    assert gauge.mean == 0.0
