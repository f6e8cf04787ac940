"""Push logs and tables of pairs: pushes of a known wrench and twist, and files spoiled in many ways."""

import math
import re

import numpy as np
import pytest
from refusals import refused_in_a_line

from planner.identification import pushes
from runtime.shell.errors import InputError

CORNER = np.array([50.0, 50.0])
FACES = {  # a point on each face, and the normal into the block
    "left": (np.array([-50.0, 5.0]), np.array([1.0, 0.0])),
    "lower": (np.array([-10.0, -50.0]), np.array([0.0, 1.0])),
    "long": (np.array([40.0, 10.0]), -np.array([1.0, 1.0]) / math.sqrt(2)),
}
SENSOR = math.sqrt(0.5) * np.array([[1.0, 1.0], [1.0, -1.0]])


def turn(angle: float) -> np.ndarray:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def pose_line(origin: np.ndarray, angle: float) -> str:
    x, y = (origin - turn(angle) @ CORNER).tolist()
    return f"{x!r} {y!r} 9.5 {math.cos(angle / 2)!r} 0 0 {math.sin(angle / 2)!r}"


def push_record(
    twist: np.ndarray,
    face: str,
    force: np.ndarray,
    place=(500.0, 100.0, 0.7),
    sideways: float = 0.0,
    slant: float = 0.3,
) -> str:
    """The text of a simulated push log with a known result.

    The tip sticks to the block. For 30 % of the time the block stands still; then it moves evenly
    until it has completed the twist.

    Args:
        twist: twist of the block in its own frame, over the whole push [mm, mm, rad].
        face: the face that the tip pushes.
        force: the force of the tip on the block.
        place: pose of the block at the start [mm, mm, rad].
        sideways: offset of the tip from the pusher's axis [mm].
        slant: angle of the pusher to the normal of the face [rad].
    """
    point = FACES[face][0]
    start, angle = np.array(place[:2]), place[2]

    def block(share: float) -> tuple[np.ndarray, float]:
        turned = share * twist[2]
        a, b = (math.sin(turned), 1 - math.cos(turned)) if turned else (0.0, 0.0)
        rotation = np.array([[a, -b], [b, a]])
        moved = rotation @ twist[:2] / twist[2] if twist[2] else share * twist[:2]
        return start + turn(angle) @ moved, angle + turned

    heading = angle + math.atan2(*(FACES[face][1] @ turn(slant).T)[::-1])  # the pusher's x axis
    times = np.arange(101) / 20
    forces, poses = [], []
    for index, t in enumerate(times):
        origin, yaw = block(max(0.0, (index - 30) / 70))
        tip = origin + turn(yaw) @ point - sideways * turn(heading)[:, 1]
        world = turn(yaw) @ force if index >= 30 else np.zeros(2)
        sensed = SENSOR.T @ (-turn(heading).T @ world) + [0.02, -0.03]
        forces.append(f"{t} {float(sensed[0])!r} {float(sensed[1])!r}")
        quaternion = f"{math.cos(heading / 2)!r} 0 0 {math.sin(heading / 2)!r}"
        poses.append(f"{t} {float(tip[0])!r} {float(tip[1])!r} 200 {quaternion}")
    after = block(1.0)
    lines = [pose_line(start, angle), pose_line(*after), "101", *forces, "101", *poses]
    return "\n".join(lines)


def log(*records: str) -> str:
    return "\n".join([str(len(records)), *records]) + "\n"


TWIST = np.array([4.0, -2.0, 0.12])
FORCE = np.array([3.0, 0.8])
LOG = log(push_record(TWIST, "left", FORCE))


def torque(point: np.ndarray, force: np.ndarray) -> float:
    return float(point[0] * force[1] - point[1] * force[0])


@pytest.mark.parametrize("place", [(500.0, 100.0, 0.7), (-30.0, 20.0, 3.1), (0.0, 0.0, -3.1)])
@pytest.mark.parametrize("twist", [TWIST, np.array([3.0, 1.0, 0.0]), np.array([0.5, 0.1, -0.3])])
def test_pairs_of_known_push_are_its_wrench_and_twist(place, twist):
    wrenches, twists = pushes.pairs(pushes.parse(log(push_record(twist, "left", FORCE, place))))
    assert np.allclose(twists, [twist], atol=1e-9)
    expected = [*FORCE, torque(FACES["left"][0], FORCE)]
    # The block moves along an arc, not along a line.
    assert np.allclose(wrenches, [expected], atol=0.2)


def test_tip_offset_is_estimated_from_faces_and_removed_from_pairs():
    motions = {"left": [4.0, -2.0, 0.1], "lower": [1.0, 5.0, -0.1], "long": [-3.0, -3.0, 0.2]}

    def record(sideways: float) -> list[pushes.Push]:
        records = [
            push_record(np.array(twist), face, 3 * FACES[face][1], (0, 0, slant), sideways, slant)
            for face, twist in motions.items()
            for slant in (-0.8, 0.0, 0.8)
        ]
        return pushes.parse(log(*records))

    assert pushes.tip_offset(record(0.0)) == pytest.approx(0.0, abs=1e-9)
    for sideways in (1.5, -0.7):  # exact except for the weak pull to 0
        assert pushes.tip_offset(record(sideways)) == pytest.approx(sideways, rel=0.15)
    with_offset, without = (pushes.pairs(record(sideways))[0] for sideways in (1.5, 0.0))
    assert np.abs(with_offset - without)[:, 2].max() < 0.2 * 1.5 * 3


LINES = LOG.splitlines()


def changed_line(index: int, line: str) -> str:
    return "\n".join([*LINES[:index], line, *LINES[index + 1 :]])


MISTAKES = {
    "empty": ("", "line 0, header: the file ends where number of pushes"),
    "half a push": (changed_line(0, "1.5"), "line 1, header: number of pushes is 1.5"),
    "infinite": (changed_line(5, "1.0 inf 2.0"), "line 6, push 1 of 1: force readings: 'inf'"),
    "column lost": (changed_line(5, "1.0 2.0"), "line 6, push 1 of 1: force readings: expected 3"),
    "pose short": (changed_line(1, "1 2 3 1 0 0"), "line 2, push 1 of 1: pose before: expected 7"),
    "no quaternion": (changed_line(2, "1 2 3 9 0 0 0"), "line 3, push 1 of 1: pose after: qw qx"),
    "truncated": ("\n".join(LINES[:-30]), "line 177, push 1 of 1: the file ends where pusher"),
    "one push over": (LOG + LOG, "line 208, push 1 of 1: more lines follow"),
    "huge count": (changed_line(3, "1e29"), "number of force readings is 1e+29"),
}


@pytest.mark.parametrize(("text", "problem"), MISTAKES.values(), ids=MISTAKES)
def test_parse_spoiled_log_raises_with_its_place_in_one_line(text, problem):
    with refused_in_a_line(InputError, rf"^my\.txt: .*{re.escape(problem)}"):
        pushes.parse(text, "my.txt")


def test_parse_any_truncated_log_raises():
    for count in range(len(LINES)):
        with pytest.raises(InputError):
            pushes.parse("\n".join(LINES[:count]))


def test_pairs_push_without_motion_or_contact_raises():
    still = log(push_record(TWIST, "left", FORCE), push_record(np.zeros(3), "left", FORCE))
    with pytest.raises(InputError, match=r"push 2 of 2: the block does not move"):
        pushes.pairs(pushes.parse(still))
    loose = log(push_record(TWIST, "left", np.zeros(2)))
    with pytest.raises(InputError, match=r"push 1 of 1: no force reading"):
        pushes.pairs(pushes.parse(loose))


HEADER = "fx_n,fy_n,tau_n_mm,vx_mm,vy_mm,omega_rad"


def test_load_columns_in_any_order_reads_the_pairs(tmp_path):
    path = tmp_path / "pairs.csv"
    path.write_text(f"{HEADER},weight\n1,2,3,4,5,6,0.5\n-1,-2,-3,-4,-5,-6,2\n", encoding="utf-8")
    first = pushes.load(path)
    assert first.wrenches.tolist() == [[1, 2, 3], [-1, -2, -3]]
    assert first.twists.tolist() == [[4, 5, 6], [-4, -5, -6]]
    assert first.weights.tolist() == [0.5, 2]
    backwards = ",".join(reversed(HEADER.split(",")))
    path.write_text(f"note,{backwards}\nx,6,5,4,3,2,1\n", encoding="utf-8")
    second = pushes.load(path)
    assert second.wrenches.tolist() == [[1, 2, 3]]
    assert second.weights.tolist() == [1]
    both = pushes.join([first, second])
    assert both.wrenches.shape == (3, 3)
    assert both.weights.tolist() == [0.5, 2, 1]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "column fx_n"),
        ("fx_n,fy_n,tau_n_mm,vx_mm,vy_mm\n1,2,3,4,5", "column omega_rad is missing"),
        (HEADER, "holds no pair"),
        (f"{HEADER}\n1,2,3,4,5,nan", "omega_rad: line 2: 'nan' is not a finite number"),
        (f"{HEADER}\n1,2,3,4,5,6\n1,2,3,4,5", "omega_rad: line 3: None is not a finite number"),
        (f"{HEADER}\n1,2,3,0,0,0", "pair 1: a wrench or twist is zero"),
        (f"{HEADER}\n1,2,3,4,5,6\n1,2,3,4,5,1e31", "pair 2: a wrench or twist is zero"),
        (f"{HEADER},weight\n1,2,3,4,5,6,0", "pair 1: a wrench or twist is zero, a weight not"),
    ],
)
def test_load_spoiled_table_raises_with_its_place(tmp_path, text, problem):
    path = tmp_path / "my.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"my\.csv: ") as caught:
        pushes.load(path)
    assert problem in str(caught.value)
