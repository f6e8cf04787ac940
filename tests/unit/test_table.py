"""The table: round trips, every kind of damage refused, the proof's refusals, look-up against a slow twin."""

import hashlib
import zlib
from dataclasses import replace
from pathlib import Path
from random import Random

import msgpack
import pytest
from grown_tables import grown_table
from runtime.table_deflate import deflate, inflate
from sample_tables import (
    GRIPPER,
    every_field_table,
    random_table,
    renumbered,
    small_table,
    with_job,
    with_leaf,
    with_node,
)

from runtime import table as table_module
from runtime.table import (
    MAX_BYTES,
    PAYLOAD_FIELDS,
    Calibration,
    Table,
    TableError,
    TableFileError,
    canonical,
    digest,
    dump,
    dumps,
    load,
    loads,
    prove,
    wilson_upper,
)

SMALL = dumps(small_table())
EVERY = dumps(every_field_table())
STEP_UM = 85_000 / 227


def framed(payload: bytes, version: object = 2) -> bytes:
    """A frame whose digest is right, so that only what is inside can be refused."""
    return bytes(msgpack.packb(["squeezetree", version, hashlib.sha256(payload).digest(), payload]))


def field(name: str) -> bytes:
    value = msgpack.unpackb(msgpack.unpackb(SMALL)[3])[PAYLOAD_FIELDS.index(name)]
    assert isinstance(value, bytes)
    return value


def with_field(name: str, value: object) -> bytes:
    fields = list(msgpack.unpackb(msgpack.unpackb(SMALL)[3]))
    fields[PAYLOAD_FIELDS.index(name)] = value
    return bytes(msgpack.packb(fields))


@pytest.mark.parametrize(
    "table",
    [
        small_table(),
        every_field_table(),
        with_job(small_table(), '{"seed":1}'),
        grown_table(1, 60),
        *(random_table(s, 30) for s in range(5)),
    ],
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


def test_canonical_moves_values_by_no_more_than_their_grid() -> None:
    table = random_table(7, 40)
    settled = canonical(table)
    before = [branch for node in table.nodes for branch in node.branches]
    after = [branch for node in settled.nodes for branch in node.branches]
    for old, new in zip(before, after, strict=True):
        assert abs(new.low_um - old.low_um) <= STEP_UM / 2 + 1
        assert abs(new.high_um - old.high_um) <= STEP_UM / 2 + 1
        assert abs(new.expected_um - old.expected_um) <= STEP_UM / 8 + 1
        assert abs(new.probability_ppm - old.probability_ppm) <= 5000
    assert all(sum(branch.probability_ppm for branch in node.branches) == 10**6 for node in settled.nodes)


def test_intervals_keep_the_counts_they_hold_on_the_default_line() -> None:
    table, calibration = random_table(8, 60), Calibration.linear(GRIPPER)
    settled = loads(dumps(table))
    for old, new in zip(table.nodes, settled.nodes, strict=True):
        for before, after in zip(old.branches, new.branches, strict=True):
            assert calibration.counts(before.low_um, before.high_um) == calibration.counts(
                after.low_um, after.high_um
            )


def test_a_moved_placement_costs_its_clearance_or_is_refused() -> None:
    table = changed_squeeze(x_um=1_040, angle_urad=1_571_500)
    settled = canonical(table).nodes[1].squeeze
    assert (settled.x_um, settled.angle_urad) == (1_000, 1_570_796)
    assert settled.clearance_um <= table.nodes[1].squeeze.clearance_um - 40 - 42.5 * 0.7
    with pytest.raises(TableError, match="node 1: on the file's grid the open fingers may touch"):
        canonical(changed_squeeze(x_um=1_040, clearance_um=30))


@pytest.mark.parametrize("written", [SMALL, EVERY], ids=["small", "every field"])
def test_every_single_bit_flip_is_refused(written: bytes) -> None:
    for at in range(len(written)):
        for bit in range(8):
            damaged = bytearray(written)
            damaged[at] ^= 1 << bit
            with pytest.raises(TableError, match=r"recompile it|pass the|not readable"):
                loads(bytes(damaged))


@pytest.mark.parametrize("written", [SMALL, EVERY], ids=["small", "every field"])
def test_every_single_bit_flip_of_the_payload_is_refused_or_another_table(written: bytes) -> None:
    payload = msgpack.unpackb(written)[3]
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


@pytest.mark.parametrize("written", [SMALL, EVERY], ids=["small", "every field"])
def test_every_truncation_is_refused_as_one(written: bytes) -> None:
    for cut in range(len(written)):
        with pytest.raises(TableError, match="cut short"):
            loads(written[:cut])


def test_appended_bytes_and_every_splice_are_refused() -> None:
    other = dumps(random_table(1, 3))
    with pytest.raises(TableError, match="bytes follow"):
        loads(SMALL + b"\0")
    for first, second in ((SMALL, other), (other, SMALL)):
        for cut in range(1, len(first)):
            for spliced in (first[:cut] + second[cut:], first[:cut] + second[-len(first) + cut :]):
                if spliced not in (SMALL, other):
                    with pytest.raises(TableError):
                        loads(spliced)


def test_damage_to_a_large_table_is_refused() -> None:
    written, random = dumps(grown_table(3, 400)), Random(3)
    for _ in range(400):
        at, length = random.randrange(len(written)), random.randrange(1, 200)
        flipped = bytearray(written)
        flipped[at] ^= 1 << random.randrange(8)
        spliced = written[:at] + written[random.randrange(len(written)) :][:length] + written[at + length :]
        for damaged in (bytes(flipped), written[:at], spliced):
            if damaged != written:
                with pytest.raises(TableError):
                    loads(damaged)


def test_a_table_of_400_nodes_and_their_leaves_is_compact() -> None:
    table = grown_table(0, 400)
    assert len(table.leaves) >= 400
    assert len(dumps(table)) <= 6000


def test_other_format_is_refused_by_its_number() -> None:
    with pytest.raises(TableError, match="format 3 is not readable; this runtime reads 1 and 2"):
        loads(framed(msgpack.unpackb(SMALL)[3], 3))
    with pytest.raises(TableError, match="format True is not readable"):
        loads(framed(msgpack.unpackb(SMALL)[3], True))


def test_longer_form_of_an_integer_is_refused() -> None:
    shapes = inflate(field("shapes"), "shapes", 100)
    needless = deflate(bytes([shapes[0] | 0x80, 0]) + shapes[1:])
    with pytest.raises(TableError, match="shapes is not in the one form"):
        loads(framed(with_field("shapes", needless)))
    with pytest.raises(TableError, match="not in the one form"):  # of msgpack, 5 as two bytes
        loads(framed(msgpack.unpackb(SMALL)[3].replace(b"\xcd\x0b\xb8", b"\xce\x00\x00\x0b\xb8")))


def test_a_placement_cannot_be_recalled_before_its_first_use() -> None:
    recalling = grown_table(1, 3, proposals=0)
    assert len({node.squeeze[:3] for node in recalling.nodes}) == 2
    fields = list(msgpack.unpackb(msgpack.unpackb(dumps(recalling))[3]))
    fields[PAYLOAD_FIELDS.index("placements")] = deflate(b"\x00\x09\x00")
    used = msgpack.packb(fields)
    with pytest.raises(TableError, match="refers to a placement before its first"):
        loads(framed(used))


def test_another_packing_of_a_column_is_refused() -> None:
    assert inflate(zlib.compress(b"abc", wbits=-15), "x", 3) == b"abc"
    other = zlib.compressobj(9, wbits=-15)
    packed = other.compress(inflate(field("lows"), "lows", 100)) + other.flush()
    stored = b"\x01\x01\x00\xfe\xff" + b"\x00"
    for stream in (packed, stored, field("lows") + b"\x00"):
        if stream != field("lows"):
            with pytest.raises(TableError, match="column lows is"):
                loads(framed(with_field("lows", stream)))


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
        (framed(b"\x90"), f"the payload is not an array of {len(PAYLOAD_FIELDS)}"),
        (framed(b"\x90", 1), "the payload is not an array of 13"),
    ],
)
def test_hostile_bytes_are_refused_with_a_reason(data: bytes, reason: str) -> None:
    with pytest.raises(TableError, match=reason):
        loads(data)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("tool", 5, "tool holds int where str belongs"),
        ("goal", [3000, True, 10571, 2, 0, 0, 0, 0, 1], "goal holds bool where int belongs"),
        ("goal", [3000, 990000, 10571, 2, 4, 0, 0, 0, 1], "goal has the kind 4"),
        ("gripper", ["2F", 85000, 27500, 9500, 230, 230, 150], "count_open is 230"),
        ("gripper", ["2F", 90, 27500, 9500, 3, 230, 50], "a table cannot tell them"),
        ("shapes", deflate(b"\x86"), "ends in the middle"),
        ("shapes", deflate(b"\x01\x04"), "a node has no branches"),
        ("shapes", deflate(b"\xff\xff\xff\xff\x7f\x04"), "more than 32"),
        ("shapes", deflate(b"\x07"), "lead to 2 nodes besides the root"),
        ("shapes", b"", "cut short"),
        ("shapes", b"\xff", "column shapes is damaged"),
        ("placements", deflate(b"\x00\x09"), "positions holds 10 integers, allowed are 8"),
        ("placements", deflate(b"\x01"), "holds 1 integers where 2 belong"),
        ("placements", deflate(b"\x01\x01\x01"), "holds 3 integers, allowed are 2"),
        ("placements", deflate(b"\x01" * 64), "longer than any table needs"),
        ("placements", None, "placements holds NoneType where bytes belongs"),
        ("jaws", deflate(b"\x01\x00"), "another order than that of their first use"),
        ("releases", deflate(b"\x02\x00"), "another order than that of their first use"),
        ("clearances", deflate(b"\x7f\x7f"), "a clearance is greater than"),
        ("spans", deflate(b"\xff\x01\x7f\x7f\x7f"), "ends beyond the gripper's counts"),
        ("alternatives", deflate(b"\xff\xff\xff\xff\x7f\x00\x00"), "alternatives, allowed are"),
        ("positions", deflate(b"\xff\xff\xff\xff\xff\x01"), "more than 35 bits"),
        ("positions", b"", "a placement, a jaw setting or a release is listed twice"),
        ("spreads", deflate(b"\x7f" * 18), "variance is greater than"),
        ("spreads", deflate(b"\x01\x01\x01\x20\x00\x00" * 3), "correlation is not in the one form"),
        ("job", b"text", "job holds bytes where str belongs"),
    ],
)
def test_wrong_field_is_refused_with_its_name(name: str, value: object, reason: str) -> None:
    # Angles alike, so that placements differ by their positions alone.
    payload = with_field(name, value)
    if name == "positions" and value == b"":
        fields = list(msgpack.unpackb(payload))
        fields[PAYLOAD_FIELDS.index("angles")] = b""
        payload = bytes(msgpack.packb(fields))
    with pytest.raises(TableError, match=reason):
        loads(framed(payload))


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
    (changed_branch(1, low_um=18_910), "node 1, branch 1: low_um is 18910"),
    (changed_branch(0, expected_um=22_500), "node 1, branch 0: expected_um is 22500"),
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


def test_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "small.msgpack"
    dump(small_table(), path)
    assert path.read_bytes() == SMALL
    assert load(path) == canonical(small_table())
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
