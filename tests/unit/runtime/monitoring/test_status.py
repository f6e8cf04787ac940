"""The status of a run, the datagrams to the service manager, and the memory that a monitor holds."""

import gc
import json
import os
import re
import socket
import tracemalloc
from dataclasses import replace
from pathlib import Path

import pytest
from fake_cell import Deaf
from sample_tables import small_table
from statuses import status_of

from runtime.execution.events import Phase, Tally
from runtime.monitoring.monitor import Monitor, Views, notify
from runtime.monitoring.status import Status
from runtime.table import load
from runtime.traversal.results import Outcome, PartResult, Step

STEP = Step(1, 0, small_table().nodes[0].squeeze, 174, 20_969, ~0, None)


def fed() -> Status:
    status = status_of(small_table(), "small.msgpack")
    status.phase(1, Phase.SQUEEZE, 0)
    status.step(STEP)
    status.part(replace(PartResult.of(1, Outcome.LEAF, [STEP], None), audit="pass"))
    status.part(PartResult.of(2, Outcome.REJECT, [], "nothing"))
    status.phase(3, Phase.PLACE, None)
    return status


def test_status_as_object_counts_outcomes_and_names_the_last_part():
    seen = json.loads(json.dumps(fed().as_object()))
    assert (seen["phase"], seen["part"], seen["node"], seen["squeezes"]) == ("place", 3, None, 1)
    assert seen["outcomes"] == {**{o.value: 0 for o in Outcome}, "leaf": 1, "reject": 1}
    assert (seen["last_width_mm"], seen["audits"]) == (20.969, {"pass": 1})
    assert seen["last_part"]["part"] == 2


SAMPLE = re.compile(r'squeezetree_[a-z_]+(\{[a-z]+="[^"]*"\})? [0-9.e+]+')


def test_as_metrics_is_prometheus_text():
    text = fed().as_metrics()
    samples, kinds = [], {}
    for line in text.splitlines():
        if line.startswith("# TYPE "):
            _, _, name, kind = line.split()
            kinds[name] = kind
        elif not line.startswith("# HELP "):
            assert SAMPLE.fullmatch(line), line
            samples.append(line)
    assert text.endswith("\n")
    assert 'squeezetree_parts_total{outcome="leaf"} 1' in samples
    assert 'squeezetree_phase{phase="place"} 1' in samples
    assert 'squeezetree_leaves_total{leaf="0"} 1' in samples
    assert 'squeezetree_audits_total{verdict="pass"} 1' in samples
    assert {re.split("[{ ]", line)[0] for line in samples} == kinds.keys()
    assert all(name.endswith("_total") == (kind == "counter") for name, kind in kinds.items())


@pytest.mark.parametrize("abstract", [False, True])
def test_monitor_notifies_ready_watchdog_and_stopping(tree, tmp_path, monkeypatch, *, abstract):
    name = f"@squeezetree-test-{os.getpid()}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind("\0" + name[1:] if abstract else name)
        monkeypatch.setenv("NOTIFY_SOCKET", name)
        with Monitor(Deaf(), load(tree), tree, Views()) as monitor:
            monitor.ready()
            monitor.phase(3, Phase.SQUEEZE, 1)
            monitor.phase(3, Phase.DONE, None)
            monitor.step(3, STEP)
            monitor.part(PartResult.of(3, Outcome.LEAF, [STEP], None), None)
            monitor.note("x")
            monitor.summary(Tally(), Path("j"))
        lines = [manager.recv(1000).decode() for _ in range(4)]
    alive = ["WATCHDOG=1\nSTATUS=part 3: squeeze, node 1", "WATCHDOG=1\nSTATUS=part 3: done"]
    assert lines == ["READY=1", *alive, "STOPPING=1"]


@pytest.mark.parametrize("address", ["", "relative", "/nobody/listens/here"])
def test_notify_without_service_manager_raises_nothing(address, monkeypatch):
    monkeypatch.setenv("NOTIFY_SOCKET", address)
    notify("READY=1")


def test_monitor_after_many_parts_holds_no_more_memory(tree):
    """All control charts run, with and without drift; the widths repeat after 500 parts."""
    with Monitor(Deaf(), load(tree), tree) as monitor:

        def run(first, last):
            for number in range(first, last):
                step = STEP._replace(width_um=20_000 + number % 500)
                monitor.phase(number, Phase.SQUEEZE, 0)
                monitor.step(number, step)
                outcome = Outcome.REJECT if number % 5 == 0 else Outcome.LEAF
                result = PartResult.of(number, outcome, [step], None)
                monitor.part(replace(result, audit="fail" if number % 7 else "pass"), None)
            gc.collect()
            return tracemalloc.get_traced_memory()[0]

        run(0, 500)
        tracemalloc.start()
        try:
            before = run(500, 1000)
            after = run(1000, 3000)
        finally:
            tracemalloc.stop()
    assert after - before < 2000  # less than a byte a part
