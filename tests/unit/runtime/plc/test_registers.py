"""The register map: complete, without overlaps, and words in the documented order."""

from runtime.plc.registers import MAP, READ, READ_AT, WRITTEN, WRITTEN_AT, as_json, words

KINDS = {"holding", "input", "coil", "discrete"}
TYPES = {"int16", "uint16", "int32", "uint32", "bool"}


def test_registers_do_not_overlap_and_each_block_has_no_gap():
    for start, block in ((WRITTEN_AT, WRITTEN), (READ_AT, READ)):
        used = [register.address + word for register in block for word in range(register.words)]
        assert used == list(range(start, start + len(used)))


def test_as_json_has_documented_keys():
    for entry, register in zip(as_json()["registers"], MAP, strict=True):
        assert entry.keys() >= {"name", "address", "kind", "type", "scale", "unit"}
        assert entry["kind"] in KINDS
        assert entry["type"] in TYPES
        assert entry["unit"] in ("", "mm", "deg", "s", "%")
        assert entry["name"] == register.name


def test_words_of_a_long_value_have_the_high_word_first():
    registers = [register for register in READ if register.name in ("table_digest", "x")]
    given = {"table_digest": 0xCAFE_0001, "x": -2}
    assert words(registers, given) == [0xCAFE, 0x0001, 0xFFFF, 0xFFFE]


def test_registers_published_addresses_are_unchanged():
    expected = {"acknowledge": 100, "busy": 101, "result_valid": 102, "result_id": 103}
    expected |= {"outcome": 104, "error_id": 105, "heartbeat_out": 106, "table_in_use": 107}
    expected |= {"table_digest": 108, "x": 110, "y": 112, "angle": 114, "part": 116, "face": 117}
    expected |= {"expected_error": 118, "expected_error_p95": 119, "exit_code": 120}
    expected |= {"parts_located": 121, "seconds_last": 129, "takt_share": 130}
    addresses = {register.name: register.address for register in READ}
    assert addresses.items() >= expected.items()
