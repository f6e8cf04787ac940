"""Pictures from a simulated cell's camera show where the part lies now, and current faults."""

import contextlib
import io
import shlex

import numpy as np
import pytest
from cameras import GOAL, NUMBER, Shown, camera, part_tag, rig, true_calibration
from soaking import small_setting

from drivers.camera.audit.auditor import PASS, UNKNOWN, Auditor, Subject
from drivers.camera.calibration import command as calibrate_command
from drivers.camera.calibration import file as calibration
from drivers.camera.vision import tag_file
from drivers.camera.vision.sources import decoded
from drivers.planar import compose
from drivers.sim import cli
from drivers.sim.camera import album
from drivers.sim.faults import Desk, Fault, Listed
from drivers.sim.physics.tabletop import BESIDE, Look, TableTop
from runtime.shell.errors import UsageError

pytestmark = pytest.mark.slow

OPTICS = camera()
RIG = rig(OPTICS)
POSE = (12.0, -8.0, 0.7)
KNOWN = true_calibration(OPTICS)


class Lying:
    """A world in which squeezes do not move the part and read 21 mm."""

    def squeeze(self, pose):
        return pose, 21.0, "grasped"


def table_top(*faults):
    """A simulated table with the given faults; its part has been squeezed once."""
    setting = small_setting()._replace(world="lying", factory=lambda subject, seed: Lying())
    top = TableTop(setting, 1, Desk(Listed(faults)))
    top.squeeze((0.0, 0.0, 0.0))
    top.gripped()
    return top


def audited(top):
    """The audit's answer if the part's true pose was predicted."""
    take = RIG.watcher(top.look, seed=1)
    source = Shown(lambda: decoded(take(), "the cell's camera"))
    auditor = Auditor(source, KNOWN, [Subject(GOAL, part_tag())])
    return auditor.audit(1, top.pose, 0.0)


def test_camera_sees_part_where_it_lies_now():
    top = table_top()
    for _ in range(2):
        assert audited(top).verdict == PASS
        top.next_part()


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        (Fault("camera_covered"), "the picture is black"),
        (Fault("camera_moved", value=2.0), "calibrate again"),
        (Fault("part_missing"), "no tag is seen"),
        (Fault("wrong_part", value=3.0), f"tag {NUMBER - 1} is seen, but the part carries tag"),
        (Fault("two_parts", value=9.0), "more than one tag lies in view"),
    ],
    ids=lambda value: value.kind if isinstance(value, Fault) else None,
)
def test_camera_fault_is_seen_only_while_it_holds(fault, says):
    top = table_top(fault)
    answer = audited(top)
    assert answer.verdict == UNKNOWN
    assert says in answer.reason
    top.squeeze((0.0, 0.0, 0.0))
    top.gripped()
    assert audited(top).verdict == PASS


def test_table_top_look_shows_faults():
    assert table_top().look() == Look(table_top().pose)
    top = table_top(Fault("two_parts", value=9.0), Fault("camera_moved", value=4.0))
    assert top.look() == Look(top.pose, second=compose(top.pose, BESIDE), moved_mm=4.0)


def test_camera_in_rehearsal_is_refused():
    assert TableTop(small_setting(), 1, Desk(Listed())).look().pose is None
    with pytest.raises(UsageError, match="lies nowhere"):
        cli.camera(small_setting())


def test_album_pictures_calibrate_camera_that_locates_part(tmp_path):
    """The album holds the pictures for a calibration. It shows two parts, and each gets a tag file."""
    names, folder = ["hex nut", "spacer; rm"], tmp_path / "a folder"
    for words in album.write(RIG, folder, 3, names):
        with contextlib.redirect_stdout(io.StringIO()):
            assert calibrate_command.main(shlex.split(words)) == 0
    fitted = calibration.load(folder / "camera.json")
    tag, other = (tag_file.load(folder / f"tag-{k}.json") for k in range(2))
    assert (tag.part, other.part) == tuple(names)
    assert (tag.number, other.number) == (RIG.number, RIG.number + 1)
    for each in (tag, other):
        assert np.hypot(each.on_part[0] - 2.0, each.on_part[1] + 1.0) < 0.1
    assert [reference.number for reference in fitted.references] == [580, 581, 582]
    picture = RIG.seen(Look(POSE), np.random.default_rng(4))
    auditor = Auditor(Shown(lambda: picture), fitted, [Subject(GOAL, tag)])
    answer = auditor.audit(1, POSE, 0.0)
    assert answer.verdict == PASS
    assert answer.distance < 0.3
