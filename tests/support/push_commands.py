"""Runs `plan-simulate --push` on a triangular block, in this process."""

import csv
import io

from programs import called

from planner.cli import simulate

JOB = """
part = { name = "triangle", outline_mm = [[0, 0], [150, 0], [0, 150]] }
friction = { finger_part_min = 0.4, finger_part_max = 0.5 }
gripper = { finger_length_mm = 20, finger_width_mm = 10, opening_mm = 85 }
uncertainty = { radius_mm = 10, orientation = "unknown" }
actions = { angles_deg = [0], centers_mm = [[0, 0]] }
goal = { distance_mm = 3, confidence = 0.9 }
pressure = { kind = "points", points_mm = [[30, 30], [90, 30], [30, 90]] }
"""
HEADER = "push_x_mm,push_y_mm,approach_x,approach_y,cor_x_mm,cor_y_mm,angle_deg"
STRAIGHT = "50,0,0,2,-5000,0,0.4"  # a turn about a far centre: 35 mm along y, nearly straight
OUTPUTS = ["moved_x_mm", "moved_y_mm", "turned_deg", "status"]


def run(folder, text, *options, job=JOB):
    """Runs `plan-simulate --push` with the pushes in the CSV text `text`.

    Returns the exit code, the rows of the result, standard output and standard error.
    """
    (folder / "job.toml").write_text(job)
    (folder / "in.csv").write_text(text)
    result = folder / "out.csv"
    words = (folder / "job.toml", "--push", folder / "in.csv", "-o", result, *options)
    code, out, err = called(simulate.main, *words)
    rows = list(csv.DictReader(io.StringIO(result.read_text()))) if result.exists() else []
    return code, rows, out, err


NOMINAL = ("--nominal", "--mu", "0.45")
