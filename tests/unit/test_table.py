"""The table: round trips, every kind of damage refused, the proof's refusals, look-up against a slow twin."""

import hashlib
from dataclasses import replace
from pathlib import Path

import msgpack
import pytest
from sample_tables import GRIPPER, random_table, renumbered, small_table, with_job, with_leaf, with_node

from runtime import table as table_module
from runtime.table import (
    MAX_BYTES,
    REJECT,
    Branch,
    Calibration,
    Node,
    Table,
    TableError,
    TableFileError,
    canonical,
    count_map,
    digest,
    dump,
    dumps,
    load,
    loads,
    prove,
    wilson_upper,
)

SMALL = dumps(small_table())


def framed(payload: bytes, version: object = 1) -> bytes:
    """A frame whose digest is right, so that only what is inside can be refused."""
    return bytes(msgpack.packb(["squeezetree", version, hashlib.sha256(payload).digest(), payload]))


def payload_fields() -> list[object]:
    return list(msgpack.unpackb(msgpack.unpackb(SMALL)[3]))


@pytest.mark.parametrize(
    "table", [small_table(), with_job(small_table(), '{"seed":1}'), *(random_table(s, 30) for s in range(5))]
)
def test_round_trip_gives_the_canonical_table_and_then_the_same_bytes(table: Table) -> None:
    data = dumps(table)
    assert loads(data) == canonical(table)
    assert dumps(loads(data)) == data
    assert canonical(canonical(table)) == canonical(table)


@pytest.mark.parametrize("seed", range(5))
def test_numbering_does_not_change_the_file(seed: int) -> None:
    table = random_table(seed, 40)
    other = renumbered(table, seed)
    assert other.nodes != table.nodes
    assert dumps(other) == dumps(table)


def test_canonical_moves_values_by_less_than_their_grid_and_intervals_outwards() -> None:
    table = random_table(7, 40)
    settled = canonical(table)
    before = [branch for node in table.nodes for branch in node.branches]
    after = [branch for node in settled.nodes for branch in node.branches]
    for old, new in zip(before, after, strict=True):
        assert 0 <= old.low_um - new.low_um < 50
        assert 0 <= new.high_um - old.high_um < 50
        assert abs(new.expected_um - old.expected_um) <= 25
        assert abs(new.probability_ppm - old.probability_ppm) <= 100
    assert all(sum(branch.probability_ppm for branch in node.branches) == 10**6 for node in settled.nodes)


def test_every_single_bit_flip_is_refused() -> None:
    for at in range(len(SMALL)):
        for bit in range(8):
            damaged = bytearray(SMALL)
            damaged[at] ^= 1 << bit
            with pytest.raises(TableError):
                loads(bytes(damaged))


def test_every_single_bit_flip_of_the_payload_is_refused_or_another_table_with_another_file() -> None:
    payload = msgpack.unpackb(SMALL)[3]
    accepted = 0
    for at in range(len(payload)):
        for bit in range(8):
            damaged = bytearray(payload)
            damaged[at] ^= 1 << bit
            data = framed(bytes(damaged))
            try:
                table = loads(data)
            except TableError:
                continue
            accepted += 1
            assert dumps(table) == data
    assert accepted > 0  # a digest made to fit a changed trial count is another table, and a legal one


@pytest.mark.parametrize("cut", range(0, len(SMALL), 7))
def test_truncations_are_refused(cut: int) -> None:
    with pytest.raises(TableError):
        loads(SMALL[:cut])


def test_appended_bytes_and_splices_are_refused() -> None:
    other = dumps(random_table(1, 3))
    with pytest.raises(TableError, match="bytes follow"):
        loads(SMALL + b"\0")
    for cut in range(1, len(SMALL)):
        spliced = SMALL[:cut] + other[cut:]
        if spliced not in (SMALL, other):
            with pytest.raises(TableError):
                loads(spliced)


def test_other_format_is_refused_by_its_number() -> None:
    with pytest.raises(TableError, match="format 3 is not readable; this runtime reads 1"):
        loads(framed(msgpack.unpackb(SMALL)[3], 3))
    with pytest.raises(TableError, match="format True is not readable"):
        loads(framed(msgpack.unpackb(SMALL)[3], True))


def test_longer_form_of_an_integer_is_refused() -> None:
    fields = payload_fields()
    assert isinstance(fields[8], bytes)
    fields[8] = bytes([fields[8][0] | 0x80, 0]) + fields[8][1:]
    with pytest.raises(TableError, match="not in the one form"):
        loads(framed(msgpack.packb(fields)))


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "damaged or cut short"),
        (b"\xdd\xff\xff\xff\xff", "damaged or cut short"),  # an array of 2^32 - 1
        (b"\xc6\xff\xff\xff\xff", "damaged or cut short"),  # four gigabytes of bytes
        (b"\x91" * 3000, "damaged or cut short"),  # nested deeper than any stack
        (b"\xc0" * (MAX_BYTES + 1), "longer than"),
        (b"\xa3abc", "not a squeezetree table"),
        (msgpack.packb(["squeezetree", 1, b"", 3]), "the frame is not"),
        (framed(b"\x90"), "the payload is not an array of 13"),
    ],
)
def test_hostile_bytes_are_refused_with_a_reason(data: bytes, reason: str) -> None:
    with pytest.raises(TableError, match=reason):
        loads(data)


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        (0, 5, "tool holds int where str belongs"),
        (3, [3000, True, 10571, 2], "goal holds bool where int belongs"),
        (6, b"\x80", "ends in the middle"),
        (6, b"\x00\x00", "not made of rows of 3"),
        (7, b"\xff\xff\xff\xff\xff\xff\xff\x01", "more than 35 bits"),
        (8, b"\x07", "1 shapes for 2 nodes"),
        (8, b"\x01\x04", "a node has 0 branches"),
        (9, b"\x00\x00\x00\x09\x00\x00", "that is not there"),
        (10, b"\x00\x00\x00", "branches end before"),
        (12, b"text", "job holds bytes where str belongs"),
    ],
)
def test_wrong_field_is_refused_with_its_name(field: int, value: object, reason: str) -> None:
    fields = payload_fields()
    fields[field] = value
    with pytest.raises(TableError, match=reason):
        loads(framed(msgpack.packb(fields)))


def changed_squeeze(**changes: int) -> Table:
    table = small_table()
    node = table.nodes[1]
    return with_node(table, 1, node._replace(squeeze=node.squeeze._replace(**changes)))


def changed_branch(number: int, **changes: int) -> Table:
    table = small_table()
    branches = list(table.nodes[1].branches)
    branches[number] = branches[number]._replace(**changes)
    return with_node(table, 1, table.nodes[1]._replace(branches=tuple(branches)))


REFUSED = [
    (changed_branch(0, target=1), "node 1 is reached a second time"),
    (changed_branch(0, target=0), "node 0 is reached a second time"),
    (changed_branch(0, target=~2), "leaf 2 is reached a second time"),
    (changed_branch(0, target=7), "node 1, branch 0: target is 7"),
    (replace(small_table(), leaves=small_table().leaves * 2), "leaf 3 is never reached"),
    (replace(small_table(), nodes=small_table().nodes * 2), "reached a second time|never reached"),
    (replace(small_table(), nodes=()), "number of nodes is 0"),
    (
        replace(small_table(), limits=replace(small_table().limits, max_depth=1)),
        "deeper than limits.max_depth",
    ),
    (replace(small_table(), limits=replace(small_table().limits, max_depth=65)), "max_depth is 65"),
    (changed_squeeze(x_um=60_001), "node 1: squeeze: x_um is 60001"),
    (changed_squeeze(opening_um=85_001), "opening_um is 85001"),
    (changed_squeeze(force_mn=60_001), "force_mn is 60001"),
    (changed_squeeze(speed_um_s=0), "speed_um_s is 0"),
    (changed_squeeze(clearance_um=-1), "clearance_um is -1"),
    (changed_squeeze(angle_urad=4_000_000), "angle_urad is 4000000"),
    (changed_branch(1, low_um=19_000), "node 1, branch 1: low_um is 19000"),
    (changed_branch(0, expected_um=22_500), "high_um is 22000"),
    (changed_branch(1, high_um=85_100), "high_um is 85100"),
    (changed_branch(0, probability_ppm=760_000), "sum to 1010000|do not sum"),
    (changed_branch(1, low_um=35_950, expected_um=36_000, high_um=36_000), "no encoder count means"),
    (
        with_leaf(small_table(), 0, small_table().leaves[0]._replace(success_ppm=985_000)),
        "refutes the confidence of 0.9900",
    ),
    (with_leaf(small_table(), 1, small_table().leaves[1]._replace(x_um=-61_000)), "leaf 1: x_um is -61000"),
    (with_leaf(small_table(), 1, small_table().leaves[1]._replace(trials=True)), "of type bool"),
    (
        with_leaf(small_table(), 2, small_table().leaves[2]._replace(covariance=(-1, 0, 0, 0, 0, 0))),
        "variance",
    ),
    (replace(small_table(), job="{}"), "not the one the table was made from"),
    (replace(small_table(), gripper=replace(GRIPPER, count_open=230)), "count_open is 230"),
]


@pytest.mark.parametrize(("table", "reason"), REFUSED, ids=[reason for _, reason in REFUSED])
def test_proof_refuses_with_the_place_and_the_reason(table: Table, reason: str) -> None:
    with pytest.raises(TableError, match=reason):
        prove(table)
    with pytest.raises(TableError, match=reason):
        dumps(table)


def test_few_trials_do_not_refute_a_leaf() -> None:
    few = small_table().leaves[0]._replace(success_ppm=950_000, trials=20)
    prove(with_leaf(small_table(), 0, few))
    with pytest.raises(TableError, match="refutes"):
        prove(with_leaf(small_table(), 0, few._replace(trials=1_000)))


@pytest.mark.parametrize(("share", "trials"), [(0.985, 200), (0.5, 30), (1.0, 12), (0.0, 5), (0.9, 20_000)])
def test_wilson_upper_is_where_the_normal_test_stops_rejecting(share: float, trials: int) -> None:
    low, high = share, 1.0
    for _ in range(80):
        p = (low + high) / 2
        rejects = (p - share) ** 2 > 1.959964**2 * p * (1 - p) / trials
        low, high = (low, p) if rejects else (p, high)
    assert wilson_upper(share * trials, trials) == pytest.approx(low, abs=1e-9)


def slow_count_map(node: Node, calibration: Calibration) -> list[int]:
    """The rule as it is written: contained, nearest expected width, lower one of two."""
    outcomes = []
    for count in range(256):
        width = calibration.width_um(count)
        held = [
            (abs(width - b.expected_um), n)
            for n, b in enumerate(node.branches)
            if b.low_um <= width <= b.high_um
        ]
        outcomes.append(min(held)[1] if held else REJECT)
    return outcomes


@pytest.mark.parametrize("seed", range(8))
def test_count_map_agrees_with_the_rule_for_every_count(seed: int) -> None:
    calibration = Calibration.linear(GRIPPER)
    for node in random_table(seed, 12).nodes:
        assert list(count_map(node, calibration)) == slow_count_map(node, calibration)


def test_count_map_of_overlapping_intervals_takes_the_nearest_expected_width() -> None:
    squeeze = small_table().nodes[0].squeeze
    node = Node(squeeze, (Branch(20_000, 22_000, 30_000, 5, ~0), Branch(21_000, 28_000, 40_000, 5, ~1)))
    calibration = Calibration(tuple(range(255_000, -1, -1_000)))
    outcomes = count_map(node, calibration)
    assert list(outcomes) == slow_count_map(node, calibration)
    assert outcomes[calibration.count(25_000)] == 0  # equally near to both
    assert outcomes[calibration.count(26_000)] == 1


def test_linear_calibration_is_robotiqs_line() -> None:
    # Robotiq SDK, units.cpp: opening_mm = 85 * (230 - gPO) / 227, clamped; 0.374 mm a count.
    calibration = Calibration.linear(GRIPPER)
    for count in range(256):
        assert calibration.width_um(count) == pytest.approx(
            min(max(85e3 * (230 - count) / 227, 0), 85e3), abs=0.5
        )
    assert calibration.count(21_000) == 174


def test_calibration_that_rises_is_refused() -> None:
    with pytest.raises(TableError, match="must not rise with the count; they do at 1"):
        Calibration((5, 6, *([0] * 254)))
    with pytest.raises(TableError, match="256 widths"):
        Calibration((5, 4))


def test_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "small.msgpack"
    dump(small_table(), path)
    assert path.read_bytes() == SMALL
    assert load(path) == small_table()
    with pytest.raises(TableError):
        dump(replace(small_table(), nodes=()), path)
    assert path.read_bytes() == SMALL
    assert [entry.name for entry in tmp_path.iterdir()] == ["small.msgpack"]
    assert digest(small_table()) == hashlib.sha256(SMALL).digest()


def test_failed_write_leaves_no_litter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        dump(small_table(), tmp_path / "small.msgpack")
    assert list(tmp_path.iterdir()) == []


def test_file_errors_name_the_file_and_carry_their_codes(tmp_path: Path) -> None:
    with pytest.raises(TableFileError, match="No such file") as missing:
        load(tmp_path / "none.msgpack")
    assert missing.value.exit_code == 3
    damaged = tmp_path / "rectangle.msgpack"
    damaged.write_bytes(SMALL[:-1] + bytes([SMALL[-1] ^ 1]))
    with pytest.raises(TableError) as refused:
        load(damaged)
    assert refused.value.exit_code == 30
    assert str(refused.value) == (
        "table rectangle.msgpack: digest does not match its content; copy the file again or recompile it"
    )


def test_exported_names_exist_once() -> None:
    assert sorted(set(table_module.__all__)) == sorted(table_module.__all__)
    assert [name for name in table_module.__all__ if not hasattr(table_module, name)] == []
