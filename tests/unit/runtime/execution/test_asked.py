"""A robot that asks line by line: each reading leads where the table says, and a bad line changes nothing."""

from random import Random

import pytest
from asked import asked_parts
from counting import width_um
from sample_tables import every_field_table, random_table, small_table

from runtime.execution.asked import ERRORS, MAX_LINE, SLOWEST_UM_S
from runtime.execution.executor import RunOptions
from runtime.execution.watch import expected_of
from runtime.table import REJECT, Table, decide, decision_map
from runtime.traversal.decision import Policy

WORDS = [
    *("NEXT", "WIDTH", "COUNTS", "STATUS", "RESET", "TABLE", "VERSION", "OBJECT", "NONE", "next"),
    *("0", "1", "21.0", "30", "174", "-1", "1e9", "nan", "", "²", "999999999999", "+5", "0x10"),
    *("\t", "é"),
]
ANSWERS = {
    *("SQUEEZE", "DRAG", "LEAF", "UNRESOLVED", "REJECT"),
    *("ERROR", "STATUS", "TABLE", "VERSION", "OK"),
}


@pytest.fixture(autouse=True)
def _quiet(capsys):
    """Captures standard output, on which the parts are printed."""


def expected(table: Table, count: int, felt: bool) -> str:
    """The answer that the table's look-up gives for a reading at the root."""
    node = table.nodes[0]
    branch = decide(decision_map(node, table.gripper), width_um(count), felt)
    if branch == REJECT:
        return "REJECT"
    if node.release_point(branch) is not None:
        return "DRAG"
    target = node.branches[branch].target
    if target >= 0:
        return f"SQUEEZE {target}"
    return f"{'LEAF' if table.leaves[~target].resolved else 'UNRESOLVED'} {~target}"


@pytest.mark.parametrize("table", [small_table(), every_field_table(), random_table(3, 60)])
def test_answer_to_any_count_at_root_follows_table_or_is_error(table):
    asked = asked_parts(table)
    for count in range(256):
        for flag in ("OBJECT", "NONE"):
            asked.answer("RESET")
            asked.answer("NEXT")
            reply = asked.answer(f"COUNTS {count} {flag} 0")
            wanted = expected(table, count, flag == "OBJECT")
            if reply.startswith("ERROR"):
                assert wanted == "REJECT"
                narrow = width_um(count) <= table.gripper.empty_um
                assert not narrow
            else:
                assert reply.startswith(wanted)


def test_answer_to_width_equals_answer_to_its_count():
    table = small_table()
    asked = asked_parts(table)
    for count in range(10, 256):
        answers = []
        for word in (f"WIDTH {width_um(count) / 1000}", f"COUNTS {count} OBJECT"):
            asked.answer("RESET")
            asked.answer("NEXT")
            answers.append(asked.answer(word).split()[:2])
        assert answers[0] == answers[1] or answers[0][0] == "REJECT"


def test_deadline_of_squeeze_is_a_few_times_its_expected_duration():
    asked, table = asked_parts(small_table()), small_table()
    assert asked.deadline is None
    asked.answer("NEXT")
    usual_s = expected_of(table, table.nodes[0], SLOWEST_UM_S).total_s
    assert 2 * usual_s < asked.deadline < 20 * usual_s


@pytest.mark.parametrize("seed", range(4))
def test_answer_to_any_line_is_short_and_error_changes_nothing(seed):
    random, table = Random(seed), every_field_table()
    asked = asked_parts(table, RunOptions(Policy.of("resqueeze,restart", "restart")))
    for _ in range(300):
        before = asked.answer("STATUS")
        words = (random.choice(WORDS) for _ in range(random.choice((1, 1, 2, 3, 4))))
        reply = asked.answer(" ".join(words))
        assert reply.isascii()
        assert "\n" not in reply
        assert len(reply) < MAX_LINE
        first, *rest = reply.split(" ", 2)
        assert first in ANSWERS
        if first == "ERROR":
            assert rest[1] == ERRORS[int(rest[0])]
            assert asked.answer("STATUS") == before
