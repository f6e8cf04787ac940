"""The register map: its fields do not overlap, and the frames printed in the manuals are decoded rightly."""

import itertools

import pytest

from drivers.robotiq.registers import (
    FAULTS,
    INPUT_FIELDS,
    MINOR,
    OUTPUT_FIELDS,
    PRIORITY,
    decode,
    fault,
    is_major,
    pack,
    speed_mm_s_of,
    unpack,
)


@pytest.mark.parametrize("fields", [OUTPUT_FIELDS, INPUT_FIELDS])
def test_fields_share_no_bit_and_state_their_source(fields):
    bits = [(field.byte, field.shift + i) for field in fields for i in range(field.width)]
    assert len(bits) == len(set(bits))
    assert all(byte < 6 and bit < 8 for byte, bit in bits)
    assert all(field.source.startswith("[") for field in fields)


@pytest.mark.parametrize("fields", [OUTPUT_FIELDS, INPUT_FIELDS])
def test_unpack_of_packed_field_returns_it_and_no_other(fields):
    for field, value in itertools.chain.from_iterable(
        ((field, value) for value in range(1 << field.width)) for field in fields
    ):
        seen = unpack(fields, pack(fields, {field.name: value}))
        assert seen.pop(field.name) == value
        assert set(seen.values()) == {0}


def test_pack_unknown_field_or_value_out_of_range_is_refused():
    with pytest.raises(ValueError, match="rPR = 256"):
        pack(OUTPUT_FIELDS, {"rPR": 256})
    with pytest.raises(ValueError, match="rSP = -1"):
        pack(OUTPUT_FIELDS, {"rSP": -1})
    with pytest.raises(ValueError, match="no register field gPO"):
        pack(OUTPUT_FIELDS, {"gPO": 1})


def test_pack_equals_blocks_of_manual():
    assert pack(OUTPUT_FIELDS, {"rACT": 1}) == bytes.fromhex("010000000000")
    full = {"rACT": 1, "rGTO": 1, "rPR": 255, "rSP": 255, "rFR": 255}
    assert pack(OUTPUT_FIELDS, full) == bytes.fromhex("090000FFFFFF")


def test_decode_reads_statuses_of_manual():
    assert decode(bytes.fromhex("390000FF0000")).moving
    seen = decode(bytes.fromhex("110000000000"))
    assert (seen.activating, seen.activated) == (True, False)
    assert decode(bytes.fromhex("310000000000")).activated
    assert decode(bytes.fromhex("3100E9000000")).fault == 9  # not the controller's
    assert decode(bytes.fromhex("31000000000A")).current_ma == 100
    seen = decode(bytes.fromhex("B90000FFBD00"))
    assert seen.activated
    assert seen.going
    assert not seen.moving
    assert (seen.object_flag, seen.fault) == (2, 0)
    assert (seen.echo_counts, seen.position_counts) == (255, 189)


def test_speed_mm_s_of_ends_is_range_of_manual():
    assert (speed_mm_s_of(0), speed_mm_s_of(255)) == (20.0, 150.0)


def test_fault_states_meaning_and_remedy():
    for code, text in FAULTS.items():
        assert str(fault(code, "closing")) == f"gripper fault 0x{code:02X} while closing: {text}"
        meaning, _, remedy = text.partition("; ")
        assert meaning
        assert remedy
        assert is_major(code) == (code not in MINOR | PRIORITY) == (code >= 0x0A)
    assert not is_major(0)
    assert is_major(0x03)  # unknown codes count as major
