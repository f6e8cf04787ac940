"""The stable faces of a solid: shares by solid angle, outlines above the tips; equal faces are merged."""

import math

import numpy as np
import pytest
import trimesh

from planner.part.importers.file import read_faces
from planner.part.importers.pieces import Options
from planner.part.tips import tips_height_mm
from runtime.shell.errors import InputError, UsageError


def read(path, mesh, **options):
    path.write_bytes(trimesh.exchange.stl.export_stl(mesh))
    return read_faces(path, Options(**{"units": "mm", **options}), tips_height_mm)


def solid_angle(a, b, distance):
    """The solid angle of a rectangle a x b, seen from a distance above its middle."""
    return 4.0 * math.asin(a * b / math.sqrt((a * a + 4 * distance**2) * (b * b + 4 * distance**2)))


def test_read_faces_brick_shares_equal_solid_angles(tmp_path):
    sides = (40.0, 25.0, 12.0)
    faces = read(tmp_path / "brick.stl", trimesh.creation.box(sides))
    assert sum(face.share for face in faces) == pytest.approx(1.0)
    assert [round(face.imported.height_mm) for face in faces] == [12, 25, 40]
    for face, (a, b, up) in zip(faces, ((40, 25, 12), (40, 12, 25), (25, 12, 40)), strict=True):
        share = 2.0 * solid_angle(a, b, 0.5 * up) / (4.0 * math.pi)
        assert face.share == pytest.approx(share, rel=1e-3)
        assert len(face.down) == 2
        assert sorted(np.ptp(face.imported.outline_mm, axis=0).round(6)) == [b, a]


def stool():
    legs = [trimesh.creation.box((6, 20, 14)).apply_translation((x, 0, 7)) for x in (-15, 15)]
    plate = trimesh.creation.box((50, 20, 6)).apply_translation((0, 0, 17))
    return trimesh.util.concatenate([*legs, plate])


def test_read_faces_separate_legs_give_their_hull_and_note_a_wider_foot(tmp_path):
    faces = read(tmp_path / "stool.stl", stool(), height_mm=8.0)
    upside_down = next(face for face in faces if face.down[0] == (0.0, 0.0, 1.0))
    assert upside_down.imported.size_mm == pytest.approx([36, 20])
    notes = " ".join(upside_down.imported.notes)
    assert "2 contours, taken as their convex hull" in notes
    assert "below the tips it is up to 7 mm wider" in notes
    upright = next(face for face in faces if face.down[0] == (0.0, 0.0, -1.0))
    assert upright.imported.size_mm == pytest.approx([50, 20])
    assert not any("wider" in note for note in upright.imported.notes)


def mushroom(cap_mm):
    """A cap of 40 x 20 mm on a stem of 20 x 10 mm, 10 mm high in all."""
    stem = trimesh.creation.box(bounds=[(10, 5, 0), (30, 15, 10)])
    cap = trimesh.creation.box(bounds=[(0, 0, 10 - cap_mm), (40, 20, 10)])
    return trimesh.util.concatenate([stem, cap])


def test_read_faces_thin_cap_up_and_down_differ(tmp_path):
    faces = read(tmp_path / "thin.stl", mushroom(4.0))
    flat = [face for face in faces if abs(face.down[0][2]) == 1.0]
    ends = {face.down: face.imported.size_mm.tolist() for face in flat}
    assert ends == {((0.0, 0.0, -1.0),): [40, 20], ((0.0, 0.0, 1.0),): [20, 10]}


def test_read_faces_thick_cap_up_and_down_are_one(tmp_path):
    faces = read(tmp_path / "thick.stl", mushroom(6.0))
    ends = [face for face in faces if abs(face.down[0][2]) == 1.0]
    assert [len(face.down) for face in ends] == [2]
    assert ends[0].imported.size_mm == pytest.approx([40, 20])


def test_read_faces_open_flat_or_drawn_part_is_refused(tmp_path):
    broken = trimesh.creation.box((20, 20, 20))
    broken.faces = broken.faces[1:]
    with pytest.raises(InputError, match="no closed solid"):
        read(tmp_path / "broken.stl", broken)
    with pytest.raises(InputError, match=r"lies 0\.8 mm high, too thin for finger tips"):
        read(tmp_path / "sheet.stl", trimesh.creation.box((20, 20, 0.8)))
    with pytest.raises(UsageError, match="name an STL file"):
        read_faces(tmp_path / "part.dxf", Options(), tips_height_mm)
