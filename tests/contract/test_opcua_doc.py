"""The section on OPC UA in tools/docs/plc.md shows states, chart, nodes and limits of the code."""

from typing import get_type_hints

from documents import DOCS, rows, section
from vision_chart import line

from runtime.plc import admission, opcua
from runtime.plc.address_space import NAMESPACE, TYPES
from runtime.plc.handshake import Error
from runtime.plc.panel import MOST_RESULTS
from runtime.plc.vision import STOP_REASONS, VIEW, Result

PAGE = (DOCS / "plc.md").read_text()
SECTION = section(PAGE, "OPC UA")
PROSE = " ".join(SECTION.split())


def test_section_shows_the_states_in_the_order_in_which_they_hold():
    assert rows(SECTION, "shown while") == [
        [
            row.when,
            row.state.outer,
            row.state.value if row.state.automatic else "",
            f"{row.packml.name.capitalize()} ({row.packml.value})",
        ]
        for row in VIEW
    ]


def test_section_names_every_method_with_its_arguments():
    with line() as each:
        methods = each.server._methods()
    expected = []
    for method in methods:
        outputs = [argument.name for argument in method.outputs]
        whole = outputs == list(Result._fields)
        expected.append(
            [
                f"`{method.path}`",
                ", ".join(argument.name for argument in method.inputs),
                "the variables of `LastResult`" if whole else ", ".join(outputs),
            ]
        )
    assert [row[:3] for row in rows(SECTION, "method")] == sorted(expected)


def test_section_names_every_variable_of_a_result():
    kinds = get_type_hints(Result)
    assert [row[:2] for row in rows(SECTION, "`LastResult/`")] == [
        [f"`{name}`", TYPES[kinds[name]].name] for name in Result._fields
    ]


def test_section_states_limits_errors_and_reasons():
    assert f"`{NAMESPACE}`" in PROSE
    for words in (
        f"silent for {admission.SESSION_S:g} s",
        f"within {admission.PATIENCE_S:g} s",
        f"last {MOST_RESULTS} results",
        f"at most {opcua.LONGEST_TEXT} characters",
    ):
        assert words in PROSE
    for error in opcua.REASONS:
        assert str(error.value) in PROSE
    for code, reason in STOP_REASONS.items():
        assert f"{code} {reason}" in PROSE
    assert str(Error.CONNECTION_LOST.value) in PROSE
