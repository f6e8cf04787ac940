"""A slice of `tools/hostile displaced`, and proof that it finds an arm that is not looked at."""

import pytest
from hostile_displaced import campaign
from soaking import small_setting

from runtime.execution.hand import Hand

PARTS = range(30)


def displaced(reports: list[str]) -> dict[str, int]:
    setting = small_setting()
    return dict(campaign(setting, setting.subject, PARTS, 1, reports.append))


def test_displaced_arm_above_tolerance_is_a_fault_and_below_it_none() -> None:
    reports: list[str] = []
    ends = displaced(reports)
    assert reports == []
    assert ends == {"above the tolerance: a fault": 27, "below the tolerance: no fault": 3}


def test_displaced_arm_without_the_check_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    where = Hand.where

    def believing(hand: Hand) -> tuple[float, float, float, float]:
        hand._sent_to = None
        return where(hand)

    monkeypatch.setattr(Hand, "where", believing)
    reports: list[str] = []
    ends = displaced(reports)
    assert ends["FAILED above the tolerance: no fault of the arm"] == len(reports) == 27
