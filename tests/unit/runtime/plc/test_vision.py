"""States of the machine vision specification and of PackML: what is shown follows from the station alone."""

from math import isnan

import pytest
from vision_chart import LOCATED, explored, line

from runtime.plc.handshake import OPEN, SIGNALS
from runtime.plc.station import FAULT, Answer
from runtime.plc.vision import Job, PackMLState, VisionState, result_of, view

CHART = list(explored())
JOB = Job(7, "id-7", "m", "two", "e" * 64, "c" * 64)
# OPC 40100-1, 8.2 and 8.3: the transitions between these states, whatever causes them.
SPECIFIED = {
    *("PreoperationalToInitialized", "PreoperationalToHalted", "ErrorToPreoperational"),
    *("OperationalToPreoperational", "OperationalToHalted", "OperationalToError", "ErrorToHalted"),
    *("InitializedToReady", "ReadyToInitialized"),
    *("ReadyToSingleExecution", "SingleExecutionToReady"),
}
# The master decides when to release a result; it may have changed the mode or withdrawn the recipe before.
OURS = {
    ("SingleExecution", "Initialized"),
    ("Error", "Ready"),
    ("Error", "Initialized"),
    ("Preoperational", "Ready"),  # by way of Initialized, in one call
}


def test_view_reaches_every_state():
    reached = [view(seen) for _, _, seen in CHART]
    assert {row.state for row in reached} == set(VisionState)
    assert {row.packml for row in reached} == set(PackMLState)


def test_view_transition_is_specified_or_follows_release():
    for before, name, after in CHART:
        left, entered = view(before).state, view(after).state
        outer = "Operational" if left.automatic and not entered.automatic else left.value
        if left is not entered and f"{outer}To{entered.value}" not in SPECIFIED:
            assert (left.value, entered.value) in OURS, name


def test_view_part_begins_only_by_start_in_ready():
    for before, name, after in CHART:
        begins = SIGNALS[after.state].busy and not SIGNALS[before.state].busy
        assert begins == (name == "StartSingleJob" and view(before).state is VisionState.READY)


def test_view_result_ends_only_by_release_or_confirmed_fault():
    for before, name, after in CHART:
        if SIGNALS[before.state].result_valid and not SIGNALS[after.state].result_valid:
            fault = view(before).state is VisionState.ERROR
            assert name == "ReleaseResultHandle" or (name == "ConfirmAll" and fault)
        if before.state in OPEN and after.state in OPEN and SIGNALS[before.state].result_valid:
            assert after.answer == before.answer


def test_result_of_located_part_has_units_of_names():
    result = result_of(JOB, ["bracket", "shim"], LOCATED)
    assert (result.ResultHandle, result.ResultId, result.MeasId) == (7, "id-7", "m")
    assert (result.X_mm, result.Y_mm, result.Angle_deg) == (-1.5, 0.25, 90.0)
    assert (result.Part, result.Face, result.Outcome) == ("shim", 1, "located")
    assert result.ExpectedError_mm == 0.02
    assert isnan(result.ExpectedErrorP95_mm)
    assert (result.RecipeId, result.TableDigest, result.Seconds) == ("two", "e" * 64, 1.25)
    assert result.ConfigurationDigest == "c" * 64


@pytest.mark.parametrize(("outcome", "code", "error"), [(2, 10, 0), (3, 11, 0), (FAULT, 20, 20)])
def test_result_of_part_without_pose_is_zero_and_fault_has_error(outcome, code, error):
    result = result_of(JOB, ["bracket"], Answer(outcome, code))
    assert (result.X_mm, result.Y_mm, result.Angle_deg, result.Part) == (0.0, 0.0, 0.0, "")
    assert isnan(result.ExpectedError_mm)
    assert (result.ExitCode, result.ErrorId) == (code, error)


def test_release_of_other_handle_keeps_part_and_result() -> None:
    with line() as each:
        each.server._select_automatic()
        each.server._prepare("one")
        each.server._start("a")
        for handle in (0, 1, 2):
            each.server._release(handle)
        assert each.exchange.glance.order is not None
        each.exchange.finish(LOCATED)
        each.server._release(2)
        assert dict(each.panel.values())["ResultManagement/ResultReady"]
        each.server._release(1)
        assert not dict(each.panel.values())["ResultManagement/ResultReady"]
