"""One deflate stream for some bytes, the same on every machine: literals only, one block (RFC 1951).

What zlib's compressor writes may change with its version, what its decompressor reads may not. So the table's
bytes are packed here, in the one way described, and unpacked by zlib.
"""

import zlib
from collections import Counter
from collections.abc import Mapping

from runtime.errors import TableError

END = 256  # the symbol after the last byte
SYMBOL_BITS = 9
SYMBOLS = (1 << SYMBOL_BITS) - 1
DYNAMIC_FROM = 64  # bytes; the code of a shorter column would outweigh what it saves
MOST_BITS = 15  # of a symbol's code (RFC 1951, 3.2.7)
# How a dynamic block writes its code lengths is itself a code. Ours is fixed, its own lengths by symbol: the
# lengths 0..15, 16 (repeat, unused), 17 and 18 (runs of zeros, 3 and 7 bits of repeat count).
LENGTH_CODE = (3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 7, 7, 7, 7, 7, 7, 6, 3, 3)
LENGTH_ORDER = (16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15)  # RFC 1951, 3.2.7
LONG_RUN, SHORT_RUN = 138, 3


def deflate(data: bytes) -> bytes:
    """A raw deflate stream of one block: fixed below `DYNAMIC_FROM` bytes, else dynamic.

    Args:
        data: any bytes.
    """
    if len(data) < DYNAMIC_FROM:
        return _packed(FIXED, FIXED_CODES, data)
    lengths = code_lengths({**Counter(data), END: 1})
    return _packed(DYNAMIC + _lengths_written(lengths), codes(lengths), data)


def inflate(data: bytes, name: str, most: int) -> bytes:
    """The bytes in a raw deflate stream.

    Args:
        data: the stream, nothing before or after it.
        name: what it is, for the error.
        most: how many bytes it may hold; no more are ever unpacked.

    Raises:
        TableError: damaged, cut short, followed by more, or holding more.
    """
    stream = zlib.decompressobj(wbits=-zlib.MAX_WBITS)
    try:
        out = stream.decompress(data, most + 1)
    except zlib.error as error:
        raise TableError(f"the column {name} is damaged ({error})") from None
    if len(out) > most:
        raise TableError(f"the column {name} is longer than any table needs")
    if not stream.eof or stream.unused_data:
        raise TableError(f"the column {name} is cut short or followed by more bytes")
    return out


def code_lengths(counts: Mapping[int, int]) -> dict[int, int]:
    """Huffman's code lengths, at most `MOST_BITS`.

    Among equal counts the lower symbol, and a symbol before a merged pair, is taken first; where a code would
    be too long the counts are halved, rounding up, until it is not.

    Args:
        counts: occurrences of each symbol that occurs, two of them at least.
    """
    ranked = sorted([count << SYMBOL_BITS | symbol for symbol, count in counts.items()])
    depths = _depths([key >> SYMBOL_BITS for key in ranked])
    if depths[0] > MOST_BITS:  # the rarest symbol has the longest code
        return code_lengths({symbol: (count + 1) // 2 for symbol, count in counts.items()})
    return dict(zip([key & SYMBOLS for key in ranked], depths, strict=False))


def codes(lengths: Mapping[int, int]) -> dict[int, str]:
    """The canonical code of some lengths, as text of 0 and 1 in stream order (RFC 1951, 3.2.2)."""
    out = {}
    code = last = 0
    for key in sorted([length << SYMBOL_BITS | symbol for symbol, length in lengths.items()]):
        length = key >> SYMBOL_BITS
        code <<= length - last
        out[key & SYMBOLS] = bin(code | 1 << length)[3:]  # the one in front keeps the zeros
        code, last = code + 1, length
    return out


def _depths(weights: list[int]) -> list[int]:
    """Depth of each leaf of Huffman's tree over rising weights, by the method of two queues."""
    leaves = len(weights)
    queue = [*weights, sum(weights) + 1]  # the leaves and what none of them outweighs, then pairs as made
    parents = [0] * (2 * leaves)
    leaf, pair = 0, leaves + 1
    for made in range(leaves + 1, 2 * leaves):
        if pair == made or queue[leaf] <= queue[pair]:
            one, leaf = leaf, leaf + 1
        else:
            one, pair = pair, pair + 1
        if pair == made or queue[leaf] <= queue[pair]:
            other, leaf = leaf, leaf + 1
        else:
            other, pair = pair, pair + 1
        queue.append(queue[one] + queue[other])
        parents[one] = parents[other] = made
    depths = [0] * (2 * leaves)
    for at in range(2 * leaves - 2, -1, -1):
        depths[at] = depths[parents[at]] + 1
    return depths[:leaves]


def _lengths_written(lengths: Mapping[int, int]) -> str:
    """The code lengths as a dynamic block writes them, runs of zeros first; the 0 of no distances last."""
    out = []
    at = 0
    for symbol in sorted(lengths):
        if symbol > at:
            out.append(ZEROS[symbol - at])
        out.append(LENGTH_CODES[lengths[symbol]])
        at = symbol + 1
    return "".join(out) + LENGTH_CODES[0]  # END is the last symbol, and always there


def _zeros(run: int) -> str:
    """So many lengths of zero: runs of up to 138, then of up to 10, then one by one (RFC 1951, 3.2.7)."""
    if run < SHORT_RUN:
        return LENGTH_CODES[0] * run
    if run <= 10:
        return LENGTH_CODES[17] + _number(run - SHORT_RUN, 3)
    taken = min(run, LONG_RUN)
    return LENGTH_CODES[18] + _number(taken - 11, 7) + _zeros(run - taken)


def _number(value: int, bits: int) -> str:
    """A number that is no code: its lowest bit comes first (RFC 1951, 3.1.1)."""
    return f"{value:0{bits}b}"[::-1]


def _packed(header: str, table: Mapping[int, str], data: bytes) -> bytes:
    bits = "".join((header, *map(table.__getitem__, data), table[END]))
    return int(bits[::-1], 2).to_bytes(-(-len(bits) // 8), "little")


LENGTH_CODES = codes(dict(enumerate(LENGTH_CODE)))
ZEROS = [_zeros(run) for run in range(END + 1)]
FIXED = "1" + _number(1, 2)  # the last block; of the fixed code (RFC 1951, 3.2.6)
FIXED_CODES = codes(dict(enumerate([8] * 144 + [9] * 112 + [7] * 24 + [8] * 8)))
DYNAMIC = (
    "1" + _number(2, 2) + _number(0, 5) + _number(0, 5) + _number(19 - 4, 4)
    + "".join(_number(LENGTH_CODE[symbol], 3) for symbol in LENGTH_ORDER)
)  # fmt: skip
