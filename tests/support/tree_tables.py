"""Tables for tests and benchmarks: the committed tables, and a table of each job in `trees/`."""

from programs import ROOT, TREES

from planner.compile import compile_job
from planner.job import model as job_file
from runtime.table import Table, TableFile, dump, load
from runtime.table.codec import FORMAT

KEPT = ROOT / "out" / f"tables-{FORMAT}"
NAMES = sorted(path.parent.name for path in TREES.glob("*/job.toml"))


def committed() -> dict[str, Table]:
    """The tables in `trees/` and in `tests/golden`, by name."""
    golden = ROOT / "tests" / "golden"
    paths = [*sorted(TREES.glob("*/*.msgpack")), *sorted(golden.glob("*.msgpack"))]
    return {path.stem: load(path).table for path in paths}


def table_of(name: str, workers: int | None = None) -> TableFile:
    """Returns the table of the job `name` in `trees/`.

    This is the committed table, or the one that an earlier call kept in `out`, if it was compiled from the
    present job. Otherwise the job is compiled, and the table is kept in `out`.
    """
    job = job_file.load(TREES / name / "job.toml")
    for path in (TREES / name / f"{name}.msgpack", KEPT / f"{name}.msgpack"):
        if path.exists() and (result := load(path)).table.job_digest == job.digest():
            return result
    KEPT.mkdir(parents=True, exist_ok=True)
    dump(compile_job(job, workers).table, path)
    return load(path)
