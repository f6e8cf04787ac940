"""Outlines of STL solids: the silhouette of what lies above the finger tips."""

import math

import numpy as np
import pytest
import shapely
import trimesh
from drawings import area, notes, read, refused

from planner.part.importers import mesh
from planner.part.importers.pieces import Options, time_limit
from planner.part.tips import tips_height_mm
from runtime.shell.errors import ExpectedError
from runtime.table import PROFILES

COUNT_MM = 0.001 * PROFILES["robotiq-2f-85"].stroke_um / 230  # of the encoder


def solid(tmp_path, mesh, **how):
    path = tmp_path / "part.stl"
    path.write_bytes(trimesh.exchange.stl.export_stl(mesh, **how))
    return path


BAD = [b"", b"solid nothing\nendsolid", b"\0" * 84, b"\xff" * 200, b"solid x\nfacet"]


@pytest.mark.parametrize("data", BAD)
def test_read_damaged_stl_is_refused(tmp_path, data):
    path = tmp_path / "bad.stl"
    path.write_bytes(data)
    refused(path, error=ExpectedError, units="mm")


def box(low, high):
    return trimesh.creation.box(bounds=[low, high])


def frustum(bottom, top, height):
    """A tapered block between two centred rectangles."""
    sides = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    levels = ((bottom, 0.0), (top, height))
    corners = [np.column_stack([sides * size, np.full(4, z)]) for size, z in levels]
    return trimesh.convex.convex_hull(np.concatenate(corners))


def together(*solids):
    return trimesh.util.concatenate(solids)


def turned(body, degrees, axis):
    turn = trimesh.transformations.rotation_matrix(math.radians(degrees), axis)
    return body.apply_transform(turn)


def test_read_thin_solid_is_accepted_and_flat_or_far_one_refused(tmp_path):
    thin = box((0, 0, 0), (40, 20, 0.8))
    result = read(solid(tmp_path, thin), units="mm")
    assert (area(result), result.height_mm) == pytest.approx((800, 0.8))
    flat = opened(thin, *np.flatnonzero(thin.face_normals[:, 2] < 0.5))
    refused(solid(tmp_path, flat), "is flat", units="mm")
    far = thin.copy().apply_translation((3e5, 0, 0))
    refused(solid(tmp_path, far), "near its origin", units="mm")


def mushroom():
    return together(box((10, 5, 0), (30, 15, 6)), box((0, 0, 6), (40, 20, 10)))


def disc(radius, low, high):
    cylinder = trimesh.creation.cylinder(radius, high - low, sections=128)
    return cylinder.apply_translation((0, 0, 0.5 * (low + high)))


TAPER = 2.0 * math.tan(math.radians(3.0))
DRAFTED = (40 - 50 * TAPER, 20 - 50 * TAPER)
SILHOUETTES = {  # solid, and the area above its tips by hand [mm2]; None: by its convex hull
    "mushroom": (mushroom(), 800),
    "mushroom upside down": (
        together(box((10, 5, 4), (30, 15, 10)), box((0, 0, 0), (40, 20, 4))),
        200,
    ),
    "waisted reel": (together(disc(15, 0, 3), disc(5, 0, 10), disc(10, 8, 10)), 100 * math.pi),
    "ball": (trimesh.creation.icosphere(subdivisions=4, radius=12), 144 * math.pi),
    "leaning block": (turned(box((0, 0, 0), (40, 20, 10)), 20.0, (0, 1, 0)), None),
    "draft of a high part": (frustum((40, 20), DRAFTED, 50), (40 - 8 * TAPER) * (20 - 8 * TAPER)),
    "draft upside down": (frustum(DRAFTED, (40, 20), 50), 800),
    "turned inside out": (mushroom(), 800),
}
SILHOUETTES["turned inside out"][0].invert()


@pytest.mark.parametrize(("body", "mm2"), SILHOUETTES.values(), ids=SILHOUETTES)
def test_read_outline_is_the_silhouette_above_the_tips(tmp_path, body, mm2):
    result = read(solid(tmp_path, body), units="mm")
    low, high = body.bounds[:, 2]
    tips = low + tips_height_mm(high - low)
    if mm2 is None:
        # For a convex solid, the hull of the corners above the tips and of the edges at their height.
        corners = body.vertices[body.vertices[:, 2] >= tips, :2]
        every = np.concatenate([corners, crossings(body, tips)])
        mm2 = shapely.convex_hull(shapely.multipoints(every)).area
    assert area(result) == pytest.approx(mm2, rel=4e-3)


def crossings(body, height):
    """The points (n, 2) where the edges of a solid pass a height."""
    one, other = body.vertices[body.edges_unique].transpose(1, 0, 2)
    passes = (one[:, 2] - height) * (other[:, 2] - height) < 0.0
    one, other = one[passes], other[passes]
    share = (height - one[:, 2]) / (other[:, 2] - one[:, 2])
    return (one + share[:, None] * (other - one))[:, :2]


@pytest.mark.parametrize("height", [6.0, 12.0, 40.0])
@pytest.mark.parametrize("draft", [-3.0, 3.0])
def test_read_drafted_part_has_the_greatest_width_above_the_tips(tmp_path, draft, height):
    loss = 2.0 * math.tan(math.radians(draft)) * height
    path = solid(tmp_path, frustum((40, 20), (40 - loss, 20 - loss), height))
    result = read(path, units="mm")
    tips = tips_height_mm(height)
    widest = max(40 - loss, 40 - loss * tips / height)
    assert abs(result.size_mm.max() - widest) < 0.1 * COUNT_MM


def opened(body, *missing):
    return trimesh.Trimesh(body.vertices, np.delete(body.faces, missing, axis=0), process=False)


def test_read_surface_open_above_or_below_is_accepted_with_a_note(tmp_path):
    plain = box((0, 0, 0), (40, 20, 10))
    for normal in ((0, 0, 1), (0, 0, -1)):  # without a top, or without a bottom
        missing = np.flatnonzero(plain.face_normals @ normal > 0.5)
        for some in (missing, missing[:1]):
            result = read(solid(tmp_path, opened(plain, *some)), units="mm")
            assert area(result) == pytest.approx(800)
            assert "surface is not closed" in notes(result)


def test_read_surface_open_at_the_tips_is_refused_with_the_place(tmp_path):
    plain = box((0, 0, 0), (40, 20, 10))
    missing = np.flatnonzero((plain.face_normals[:, [0, 2]] > 0.5).any(axis=1))
    path = solid(tmp_path, opened(plain, *missing))
    refused(path, r"hole in its surface near \(.*, 5\) mm", units="mm")


def test_read_fine_mesh_is_accepted_or_refused_as_slow_by_its_time_limit(tmp_path):
    path = solid(tmp_path, trimesh.creation.icosphere(subdivisions=5, radius=7))
    assert area(read(path, units="mm")) == pytest.approx(49 * math.pi, rel=4e-3)
    data = path.read_bytes()
    with pytest.raises(ExpectedError, match="longer than"), time_limit(0.02):
        mesh.read(data, Options(units="mm"))
