"""Distances, overlaps and contacts of part and fingers, against shapely's geometry of the same shapes."""

import math

import numpy as np
import pytest
import shapely
from problems import finger_box, place, random_convex, random_poses, random_star

from planner.belief.particles import initial
from planner.mechanics import clearance, contacts
from planner.mechanics.clearance import SIDE_MARGIN_MM, first_contacts_mm, jaws_of
from planner.mechanics.contacts import CORNER, END, FACE, OUTER

HALF, THICKNESS, FAR = 13.75, 9.5, 42.5
FINGERS = pytest.mark.parametrize("finger", [1, -1])


def columns(points: np.ndarray) -> np.ndarray:
    """Converts points (N, 2) to the layout of the kernels (2, N)."""
    return np.ascontiguousarray(points.T)


def hand_at(top: float, bottom: float, half: float = HALF) -> contacts.Hand:
    """Two fingers that face each other, with their inner faces at y = top and bottom."""
    upper, lower = (
        contacts.Finger(side, 0.0, face, half, THICKNESS) for side, face in ((1, top), (-1, bottom))
    )
    return contacts.Hand(upper, lower, 2)


def matches(points: np.ndarray, pose: np.ndarray, top: float, bottom: float, margin: float):
    """The contacts of a part with two fingers whose inner faces are at y = top and bottom."""
    return contacts_with(hand_at(top, bottom), points, pose, margin)


def contacts_with(hand: contacts.Hand, points: np.ndarray, pose: np.ndarray, margin: float):
    """The contacts of a part with a hand; a gap of at most `margin` counts as a contact."""
    result = np.zeros(contacts.MAX_CONTACTS, contacts.CONTACT)
    out = np.zeros(len(points), np.int64)
    return result[: contacts.find(result, columns(points), out, pose, hand, margin)]


def scenes(seed: int, count: int, radius: float = 30.0):
    """Yields random parts at random poses: the random generator, the placed outline and the pose.

    Two of three outlines are concave.
    """
    rng = np.random.default_rng(seed)
    for k in range(count):
        star = k % 3 > 0
        outline = random_star(rng, int(rng.integers(4, 14))) if star else random_convex(rng, 6)
        pose = random_poses(rng, 1, radius)[0]
        yield rng, place(outline, pose), pose


def test_find_fingers_side_by_side_equals_each_alone():
    """Both fingers of a pushing hand face the same way. The hand has the contacts of each finger alone."""
    rng, apart, near_both = np.random.default_rng(13), 5.0, 0
    for _, points, pose in scenes(5, 300):
        face = points[:, 1].max() - rng.uniform(0.0, 3.0)

        def rows(middle: float, *centres: float, points=points, pose=pose, face=face):
            fingers = [contacts.Finger(1, x, face, 4.75, 27.5) for x in centres]
            hand = contacts.Hand(fingers[0], fingers[-1], len(centres))
            met = contacts_with(hand, points - [middle, 0.0], pose - [middle, 0.0, 0.0], 0.5)
            names = ["finger", "kind", "side", "vertex", "x", "y", "nx", "ny", "gap"]
            return sorted(tuple(round(each, 9) for each in row) for row in met[names].tolist())

        both, left, right = rows(0.0, -apart, apart), rows(-apart, 0.0), rows(apart, 0.0)
        near_both += bool(left) and bool(right)
        if len(both) < contacts.MAX_CONTACTS:
            assert both == sorted(left + right)
    assert near_both > 2


@FINGERS
def test_clearance_equals_distance_to_the_part_below_the_finger(finger):
    missed = 0
    strip = shapely.box(-HALF, -500.0, HALF, 500.0)
    for _, points, _ in scenes(2, 100):
        below = shapely.intersection(shapely.Polygon(points), strip)
        way = clearance.clearance(columns(points), finger, finger * 100.0, HALF)
        if below.is_empty:
            missed += 1
            assert way == math.inf
        else:
            extreme = below.bounds[3] if finger == 1 else -below.bounds[1]
            assert way == pytest.approx(100.0 - extreme, abs=1e-9)
    assert 0 < missed < 75


@FINGERS
def test_blocked_where_finger_and_part_share_area(finger):
    """A finger is blocked also if no vertex of the part is in it, and if the part surrounds the finger."""
    verdicts = set()
    for rng, points, _ in scenes(4, 150, radius=20.0):
        points = points * rng.choice([0.3, 1.0, 3.0])
        face = finger * rng.uniform(-5.0, 40.0)
        shared = shapely.Polygon(points).intersection(finger_box(finger, face)).area
        if 0.0 < shared < 1e-6:
            continue
        verdict = clearance.blocked(columns(points), finger, face, HALF, THICKNESS)
        assert verdict == (shared > 0.0)
        verdicts.add(verdict)
    assert verdicts == {True, False}


@FINGERS
def test_find_at_first_touch_returns_a_contact_with_its_gap(finger):
    touched = 0
    for rng, points, pose in scenes(6, 150, radius=25.0):
        way = clearance.clearance(columns(points), finger, finger * 100.0, HALF)
        if math.isinf(way):
            continue
        touched += 1
        gap = rng.uniform(0.0, 1e-3)
        faces = {1: FAR + 60, -1: -FAR - 60, finger: finger * (100.0 - way + gap)}
        met = matches(points, pose, faces[1], faces[-1], margin=0.5)
        assert (met["finger"] == finger).all()
        along_y = met["gap"] / np.abs(met["ny"])
        assert along_y.min() == pytest.approx(gap, abs=1e-9)
    assert touched > 60


def nearly_closed(rng: np.random.Generator, points: np.ndarray) -> tuple[float, float]:
    """Random y of the inner faces of the upper and the lower finger, up to 0.3 mm from first contact.

    The face of a finger that would pass beside the part is at `FAR`.
    """
    ways = [clearance.clearance(columns(points), f, f * 100.0, HALF) for f in (1, -1)]
    top, bottom = (100.0 - way + rng.uniform(0.0, 0.3) if way < math.inf else FAR for way in ways)
    return top, -bottom


def beside(rng: np.random.Generator, points: np.ndarray, pose: np.ndarray) -> tuple[float, float]:
    """Changes `points` and `pose`: the part lies just right of the fingers; returns y of their inner faces.

    The upper finger reaches down past the part's leftmost vertex; the lower one is far away.
    """
    leftmost = points[points[:, 0].argmin()]
    shift = HALF + rng.uniform(0.0, 0.3) - leftmost[0]
    points[:, 0] += shift
    pose[0] += shift
    return leftmost[1] - rng.uniform(1.0, 8.0), -FAR


def test_find_returns_pairs_of_features_at_their_gap():
    """A contact states a point on the part. The finger's point lies one gap away, against the normal."""
    kinds = []
    for rng, points, pose in scenes(7, 200, radius=20.0):
        top, bottom = (
            nearly_closed(rng, points) if rng.random() < 0.7 else beside(rng, points, pose)
        )
        part = shapely.Polygon(points)
        for contact in matches(points, pose, top, bottom, margin=0.5):
            box = finger_box(contact["finger"], top if contact["finger"] == 1 else bottom)
            kinds.append(contact["kind"])
            normal = np.array([contact["nx"], contact["ny"]])
            on_part = pose[:2] + np.array([contact["x"], contact["y"]])
            corner = on_part - contact["gap"] * normal
            assert np.hypot(*normal) == pytest.approx(1.0, abs=1e-12)
            assert part.exterior.distance(shapely.Point(on_part)) < 1e-9
            assert box.exterior.distance(shapely.Point(corner)) < 1e-9
            if contact["kind"] in (CORNER, OUTER):
                face = top if contact["finger"] == 1 else bottom
                face += contact["finger"] * THICKNESS * (contact["kind"] == OUTER)
                assert np.allclose(corner, [contact["side"] * HALF, face], atol=1e-9)
                edge = points[(contact["vertex"] + 1) % len(points)] - points[contact["vertex"]]
                assert abs(edge @ normal) < 1e-9 * np.hypot(*edge)
            else:
                assert np.allclose(on_part, points[contact["vertex"]], atol=1e-9)
    assert all(kinds.count(kind) > 5 for kind in (FACE, CORNER, END)), kinds


def test_find_full_buffer_keeps_the_nearest_contacts():
    """A part with 30 teeth under the finger has more contacts than the buffer holds."""
    teeth = np.linspace(12.0, -12.0, 61)
    heights = np.where(np.arange(61) % 2 == 1, 10.0 + 0.01 * np.arange(61), 5.0)
    points = np.concatenate([[[-12.5, 0.0], [12.5, 0.0]], np.column_stack([teeth, heights])])
    met = matches(points, np.zeros(3), 10.7, -FAR, margin=1.0)
    expected = np.sort(10.7 - heights[heights > 6.0])[: contacts.MAX_CONTACTS]
    assert len(met) == contacts.MAX_CONTACTS
    assert np.allclose(np.sort(met["gap"]), expected)


@FINGERS
def test_find_part_behind_a_finger_touches_its_outer_corner(finger):
    """One contact is at the finger's outer corner; its gap is the distance to the part's slanted edge."""
    face = finger * 20.0
    corner = np.array([HALF, face + finger * THICKNESS])
    normal = np.array([1.0, finger]) / np.sqrt(2.0)
    along = np.array([-finger, 1.0]) / np.sqrt(2.0)
    near = corner + 0.2 * normal
    ends = near + 3.0 * np.outer([-1.0, 1.0], along)
    square = shapely.orient_polygons(shapely.Polygon([*ends, *(ends[::-1] + 5.0 * normal)]))
    points = shapely.get_coordinates(square)[:-1]
    faces = {finger: face, -finger: -finger * 60.0}
    met = matches(points.copy(), np.zeros(3), faces[1], faces[-1], margin=0.5)
    (outer,) = met[met["kind"] == OUTER]
    assert outer["gap"] == pytest.approx(0.2)
    assert np.allclose([outer["nx"], outer["ny"]], normal)


def meets(outline, pose, width_mm, jaws, share):
    """Slow reference version: whether jaws that are `width_mm` apart overlap the edges of the part."""
    corners = place(outline, pose)
    ends = np.roll(corners, -1, axis=0)
    edge = np.concatenate(
        [a + np.linspace(0, 1, 200)[:, None] * (b - a) for a, b in zip(corners, ends, strict=True)]
    )
    before = edge[np.abs(edge[:, 0]) <= 0.5 * jaws.length_mm]
    top = 0.5 * jaws.opening_mm - share * (jaws.opening_mm - width_mm)
    return bool((before[:, 1] > top).any() or (before[:, 1] < top - width_mm).any())


@pytest.mark.parametrize("share", [0.0, 0.4, 0.5, 1.0])
def test_first_contacts_mm_at_each_pose_is_where_jaws_begin_to_meet_the_part(job, share):
    outline, jaws = job.part.outline_mm, jaws_of(job.gripper)
    poses = initial(job, 60, np.random.default_rng(5))
    contact = first_contacts_mm(outline, jaws, poses, np.full(60, share))
    longer = jaws._replace(length_mm=jaws.length_mm + 2.0 * SIDE_MARGIN_MM)
    assert np.ptp(contact) > 1.0
    assert np.all((contact >= 0.0) & (contact <= jaws.opening_mm))
    for pose, width_mm in zip(poses, contact.tolist(), strict=True):
        assert not meets(outline, pose, width_mm + 0.1, longer, share)
        assert meets(outline, pose, width_mm - 0.1, longer, share)
