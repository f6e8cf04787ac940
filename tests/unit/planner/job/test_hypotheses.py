"""Jobs with several parts: hypotheses, foreign parts, and parts that are turned over."""

import json
import tomllib

import numpy as np
import pytest
from programs import TREES

from planner.job import model as job_file
from planner.job.hypotheses import FOREIGN
from planner.mechanics.simulator import Simulator
from planner.part import symmetry
from runtime.shell.errors import InputError
from runtime.traversal.answer import frames_in

CORNERS = {
    "kind": "points",
    "points_mm": [[1.0, 1.0], [30.0, 2.0], [2.0, 20.0]],
    "weights": [1.0, 2.0, 3.0],
}
COUPLED = {
    "kind": "stated",
    "rho_mm": 12.0,
    "ellipsoid": [[1.0, 0.1, 0.2], [0.1, 1.2, -0.1], [0.2, -0.1, 0.9]],
}


def several(**more):
    """The document of a job with three parts; `more` adds or replaces top-level keys."""
    names = ("hex-nut", "spacer", "oval-cover")
    documents = [tomllib.loads((TREES / name / "job.toml").read_text()) for name in names]
    common = {key: value for key, value in documents[0].items() if key != "part"}
    return {**common, "hypothesis": [{"part": document["part"]} for document in documents], **more}


def read(document):
    return job_file.of_document(document, "the job", drawn=True)


def test_from_canonical_several_parts_restores_the_job():
    job = read(several())
    assert job_file.from_canonical(job.canonical()) == job
    assert [alone.part.symmetry for alone in job.alone] == [6, 2, 2]
    assert sum(job.shares) == pytest.approx(1.0)
    alone = job_file.load(TREES / "spacer" / "job.toml")
    assert job.search.particles == 3 * alone.search.particles
    assert read(several(search={"particles": 70})).search.particles == 70
    assert "part" not in job_file._document(job)


def broken(number=1, **entry):
    """The document of a job with three parts; `entry` adds or replaces keys of hypothesis `number`."""
    document = several()
    document["hypothesis"][number - 1] |= entry
    return document


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (several(part={}), r"\[part\]: stands beside \[\[hypothesis\]\]"),
        (several(hypothesis=3), "2 to 16 entries"),
        (several(hypothesis=several()["hypothesis"][:1]), "2 to 16 entries"),
        (broken(share=0.5), "stated for all or none"),
        (broken(2, shape=1), "unknown key 'shape'"),
        (broken(2, part=3), "missing section part"),
        (broken(2, name="other"), "differs from the name of its part"),
        (broken(3, part={"name": "x"}), r"\[hypothesis 3.part\]: missing key outline_mm"),
        (broken(1, part=several()["hypothesis"][1]["part"]), "stands twice"),
        (several(search={"method": "paper"}), "plans for one part"),
        (several(delivery={"drop": [0, 0, 0]}), "is of one part"),
        (several(**{FOREIGN: []}), "1 to 16 entries"),
        (several(**{FOREIGN: [{"part": {"name": "x"}}]}), r"\[stranger 1.part\]: missing key"),
    ],
)
def test_of_document_invalid_hypotheses_are_refused_with_their_place(document, message):
    with pytest.raises(InputError, match=message):
        read(document)


def test_of_document_foreign_part_is_kept_apart_from_hypotheses():
    one = several()["hypothesis"][1]
    job = read(several() | {FOREIGN: [{**one, "pressure": {"kind": "uniform"}}]})
    assert job_file.from_canonical(job.canonical()) == job
    (foreign,) = job.foreign_parts
    assert (foreign.part.name, foreign.pressure.kind) == (one["part"]["name"], "uniform")
    assert all(not alone.foreign_parts for alone in (*job.alone, foreign))
    assert len(job.alone) == 3


def test_load_either_face_that_looks_alike_with_picks_is_refused():
    """No squeeze tells the faces of a rectangle apart; so nobody knows at which place a pick is."""
    path = TREES / "rectangle" / "job.toml"
    assert not job_file.load(path, {"part": {"faces": "either"}}).hypothesis
    named = {"faces": "either", "datum": [0, 0, 0], "picks": {"rim": [5, 2, 10]}}
    with pytest.raises(InputError, match="no squeeze tells the faces apart"):
        job_file.load(path, {"part": named})


def test_load_either_face_mirrors_datum_and_picks():
    named = {"faces": "either", "datum": [4, 3, 30], "picks": {"rim": [5, 2, 10]}}
    either = job_file.load(TREES / "gusset" / "job.toml", {"part": named})
    entries = json.loads(either.canonical())["hypothesis"]
    one, other = (frames_in(entry["part"]) for entry in entries)
    mirror = np.array([1.0, -1.0, -1.0])
    np.testing.assert_allclose(other.datum, one.datum * mirror)
    np.testing.assert_allclose(other.picks["rim"], one.picks["rim"] * mirror)


@pytest.mark.parametrize("pressure", [{}, CORNERS, COUPLED], ids=["boundary", "points", "stated"])
def test_roll_out_part_turned_over_is_the_mirror_image(pressure):
    changes = {"part": {"faces": "either"}, "pressure": pressure}
    one, other = job_file.load(TREES / "gusset" / "job.toml", changes).alone
    assert not symmetry.congruent(one.part.outline_mm, other.part.outline_mm)
    rng, mirror = np.random.default_rng(3), np.array([1.0, -1.0, -1.0])
    poses = rng.uniform((-8, -8, -np.pi), (8, 8, np.pi), (60, 3))
    ends = []
    for job, start in ((one, poses), (other, poses * mirror)):
        simulator = Simulator.of_job(job, workers=1)
        ends.append(simulator.roll_out(start, simulator.nominal(len(start), 0.5)))
    near = np.isclose(ends[0].width_mm, ends[1].width_mm, atol=0.05)
    assert near.mean() > 0.9  # rounding decides which way an unstable equilibrium falls
    np.testing.assert_allclose(ends[1].poses[near], ends[0].poses[near] * mirror, atol=0.1)
