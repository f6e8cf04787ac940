"""tools/docs/plc.md shows the registers, states, errors, nodes and limits of the code."""

import re
from typing import get_type_hints

from documents import DOCS, rows, section
from vision_chart import line

from runtime.commands import plc
from runtime.plc import admission, modbus, opcua
from runtime.plc.address_space import NAMESPACE, TYPES
from runtime.plc.handshake import SIGNALS, TABLE, Error, Event, State
from runtime.plc.panel import MOST_RESULTS
from runtime.plc.registers import HEARTBEAT_LIMIT_S, MAP, READ, WRITTEN
from runtime.plc.vision import STOP_REASONS, VIEW, Result

PAGE = (DOCS / "plc.md").read_text()


def shown(state: State, event: Event) -> str:
    after, error = TABLE[state, event]
    if error:
        return f"error {error.value}"
    return "-" if after is state else after.value


def test_plc_page_shows_state_table_of_code():
    head = re.search(r"^\| state \| (.*) \|$", PAGE, re.MULTILINE)
    assert head is not None
    signals, *names = head[1].split(" | ")
    assert signals.split(", ") == ["acknowledge", "busy", "result_valid"]
    events = [Event(name) for name in names]
    expected = [
        [state.value, ", ".join(str(int(signal)) for signal in SIGNALS[state])]
        + [shown(state, event) for event in events]
        for state in State
    ]
    assert rows(PAGE, "state") == expected
    refused = dict(rows(PAGE, "event"))
    assert {*events, *map(Event, refused)} == set(Event)
    for name, error in refused.items():
        for state in State:
            assert shown(state, Event(name)) == f"error {error}"


def test_plc_page_lists_every_register():
    def expected(register):
        last = register.address + register.words - 1
        address = str(register.address) if register.words == 1 else f"{register.address}, {last}"
        value = f"x {register.scale:g} {register.unit}" if register.unit else ""
        return [f"`{register.name}`", address, register.type, value, register.meaning]

    row = r"^\| (`\w+`) \| (\d+(?:, \d+)?) \| (\w+) \| ([^|]*)\| (.*) \|$"
    match = re.findall(row, PAGE, re.MULTILINE)
    listed = [[cell.strip() for cell in row] for row in match]
    assert listed == [expected(register) for register in MAP]
    words = sum(each.words for each in READ)
    assert f"read {words} registers from address {READ[0].address}" in PAGE
    assert f"write {len(WRITTEN)} from address {WRITTEN[0].address}" in PAGE


def test_plc_page_explains_every_error_and_limit():
    explained = [row[0] for row in rows(PAGE, "`error_id`")]
    assert explained == ["1, 20, 21, 24, 40", *(str(error.value) for error in Error if error)]
    seconds = modbus.KEEPALIVE.values()
    idle, interval, count = seconds
    for words in (
        f"has not changed for {HEARTBEAT_LIMIT_S:g} s",
        f"only reads gives way after {modbus.PANEL_S:g} s",
        f"not complete within {modbus.PATIENCE_S:g} s",
        f"lost power is detected after {idle + interval * count} s",
    ):
        assert words in PAGE
    for option in (f"--{name}" for name in plc.OF_ONE_TABLE):
        assert f"`{option}`" in PAGE


SECTION = section(PAGE, "OPC UA")
PROSE = " ".join(SECTION.split())


def test_plc_page_shows_opcua_states_in_order():
    assert rows(SECTION, "shown while") == [
        [
            row.when,
            row.state.outer,
            row.state.value if row.state.automatic else "",
            f"{row.packml.name.capitalize()} ({row.packml.value})",
        ]
        for row in VIEW
    ]


def test_plc_page_names_every_opcua_method_with_arguments():
    with line() as each:
        methods = each.server._methods()
    expected = []
    for path, _, inputs, given in methods:
        outputs = [argument.Name for argument in given]
        whole = outputs == list(Result._fields)
        expected.append(
            [
                f"`{path}`",
                ", ".join(argument.Name for argument in inputs),
                "the variables of `LastResult`" if whole else ", ".join(outputs),
            ]
        )
    assert [row[:3] for row in rows(SECTION, "method")] == sorted(expected)


def test_plc_page_names_every_opcua_variable_of_result():
    kinds = get_type_hints(Result)
    assert [row[:2] for row in rows(SECTION, "`LastResult/`")] == [
        [f"`{name}`", TYPES[kinds[name]].name] for name in Result._fields
    ]


def test_plc_page_states_opcua_limits_errors_and_reasons():
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
