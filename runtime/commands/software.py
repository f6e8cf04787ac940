"""Software of a run: files, versions, and the signature that covers them."""

import argparse
import hashlib
import sys
from pathlib import Path

from runtime import VERSION
from runtime.execution import calibration
from runtime.table import TableFile


def installed(arguments: argparse.Namespace, tree: Path, loaded: TableFile) -> dict[str, object]:
    """Entry of a run in the log of installed software, besides its table's bytes.

    Args:
        arguments: of `grasp-runtime`.
        tree: the table's file.
        loaded: the table of the run.

    Raises:
        InputError: the calibration's file is refused.
        InputError: the key of `--require-signed` cannot be used.
        PackError: no pack signed by it vouches for table and calibration.
        UsageError: the extra for signatures is missing.
    """
    path = arguments.calibration
    measured = None if path is None else calibration.bytes_of(path)
    signer: dict[str, object] = {"signer": None, "fingerprint": None, "pack_sha256": None}
    if arguments.require_signed is not None:
        from runtime.signing import keys, pack  # with a library that no other run has to load

        trusted = keys.load_public(arguments.require_signed)
        fields = pack.covering(tree, loaded.data, measured, trusted).fields()
        signer = {name: fields[name] for name in signer}
    return {
        "table": str(tree),
        "compiled_by": loaded.table.tool,
        "job_sha256": loaded.table.job_digest.hex(),
        "calibration": None if path is None else str(path),
        "calibration_sha256": None if measured is None else hashlib.sha256(measured).hexdigest(),
        "squeezetree": VERSION,
        "python": sys.version.split()[0],
        **signer,
    }
