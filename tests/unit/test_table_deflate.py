"""The packing of columns: read by zlib, the same as a plain Huffman construction, bounded when unpacked."""

import zlib
from collections import Counter
from heapq import heapify, heappop, heappush
from random import Random

import pytest
from runtime.table_deflate import (
    DYNAMIC_FROM,
    END,
    FIXED_CODES,
    MOST_BITS,
    code_lengths,
    codes,
    deflate,
    inflate,
)

from runtime.table import TableError


def samples() -> list[bytes]:
    random = Random(1)
    out = [b"", b"\0", b"\xff" * 500, bytes(range(256)) * 3, random.randbytes(3000)]
    out += [bytes(min(255, int(random.expovariate(0.2))) for _ in range(n)) for n in (1, 63, 64, 65, 900)]
    return out


@pytest.mark.parametrize("data", samples(), ids=lambda data: f"{len(data)} bytes")
def test_zlib_reads_what_is_written_and_nothing_is_left_over(data: bytes) -> None:
    packed = deflate(data)
    assert zlib.decompress(packed, wbits=-15) == data
    assert inflate(packed, "sample", len(data)) == data
    fixed = -(-(3 + sum(len(FIXED_CODES[byte]) for byte in data) + 7) // 8)
    assert len(packed) <= fixed + 120


def optimal_bits(counts: dict[int, int]) -> int:
    """Bits of a Huffman code, by merging the two least."""
    heap = list(counts.values())
    heapify(heap)
    bits = 0
    while len(heap) > 1:
        merged = heappop(heap) + heappop(heap)
        bits += merged
        heappush(heap, merged)
    return bits


@pytest.mark.parametrize("seed", range(6))
def test_code_lengths_are_a_complete_code_of_least_length(seed: int) -> None:
    random = Random(seed)
    symbols = random.sample(range(256), 5 + 40 * seed)
    counts = {symbol: int(random.expovariate(0.01)) + 1 for symbol in symbols}
    counts[END] = 1
    lengths = code_lengths(counts)
    assert set(lengths) == set(counts)
    assert sum(2.0**-length for length in lengths.values()) == 1.0
    assert sum(counts[symbol] * lengths[symbol] for symbol in counts) == optimal_bits(counts)
    written = codes(lengths).values()
    assert not any(a != b and b.startswith(a) for a in written for b in written)


def test_codes_longer_than_the_format_allows_are_shortened() -> None:
    numbers = [1, 1]
    while len(numbers) < 26:
        numbers.append(numbers[-1] + numbers[-2])
    data = b"".join(bytes([symbol]) * count for symbol, count in enumerate(numbers))
    lengths = code_lengths({**Counter(data), END: 1})
    assert max(lengths.values()) <= MOST_BITS
    assert sum(2.0**-length for length in lengths.values()) == 1.0
    assert zlib.decompress(deflate(data), wbits=-15) == data


def test_lone_symbol_has_one_bit() -> None:
    assert code_lengths({END: 7})[END] == 1


def test_the_change_from_fixed_to_dynamic_is_where_it_says() -> None:
    assert deflate(b"\x07" * (DYNAMIC_FROM - 1))[0] & 7 == 0b011
    assert deflate(b"\x07" * DYNAMIC_FROM)[0] & 7 == 0b101


def test_more_than_allowed_is_not_unpacked() -> None:
    bomb = zlib.compressobj(9, wbits=-15)
    packed = bomb.compress(bytes(50_000_000)) + bomb.flush()
    with pytest.raises(TableError, match="column bomb is longer than any table needs"):
        inflate(packed, "bomb", 1000)


@pytest.mark.parametrize(
    ("stream", "reason"),
    [
        (b"", "cut short or followed"),
        (deflate(b"abc")[:-1], "cut short or followed"),
        (deflate(b"abc") + b"\0", "cut short or followed"),
        (b"\xff\xff", "is damaged"),
    ],
)
def test_what_is_not_one_stream_is_refused(stream: bytes, reason: str) -> None:
    with pytest.raises(TableError, match=f"the column x .*{reason}|the column x {reason}"):
        inflate(stream, "x", 100)
