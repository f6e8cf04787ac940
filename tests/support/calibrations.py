"""Calibrations of a 2F-85, as `grasp-calibrate width` writes them."""

from pathlib import Path

from counting import PROFILE, width_um

from runtime.execution.calibration import Gauge, fit, save


def linear(path: Path, name: str = "S/N 1") -> Path:
    """Writes the calibration of a gripper whose counts are linear in the width; returns its path."""
    counts = (230, 200, 150, 100, 50, 3)
    gauges = [Gauge((230 - count) * 85.0 / 227.0, (width_um(count),)) for count in counts]
    save(fit(gauges, PROFILE, name, "2026-01-01T00:00:00Z"), path)
    return path
