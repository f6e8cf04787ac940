"""Lines of JSON whose last field, `digest`, is the SHA-256 of the line without it: a journal's records.

`previous`, the field before it, is the digest of the line before, `GENESIS` in the first line.
"""

import hashlib

GENESIS = "0" * 64
_MARK, _END = b',"digest":"', b'"}\n'
_LENGTH = len(_MARK) + len(GENESIS) + len(_END)


def sealed(body: bytes) -> tuple[bytes, str]:
    """The line of an object in JSON, and its digest."""
    digest = hashlib.sha256(body).hexdigest()
    return body[:-1] + _MARK + digest.encode("ascii") + _END, digest


def is_intact(line: bytes) -> bool | None:
    """Whether a line has the digest that it ends with; None where it ends with none."""
    if not line[-_LENGTH:].startswith(_MARK):
        return None
    return line == sealed(line[:-_LENGTH] + b"}")[0]
