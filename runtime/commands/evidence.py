"""The command `grasp-evidence`: signs a cell's table and calibration as a pack, and verifies packs."""

import argparse
import os
import socket
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from getpass import getuser
from pathlib import Path

from runtime import VERSION
from runtime.devices.clock import SystemClock
from runtime.errors import PackError
from runtime.execution import calibration
from runtime.shell.command import Body, Commands, Parser, add_command, run, say_result, tell
from runtime.shell.exit_codes import ExitCode, epilog
from runtime.shell.files import OutputError, usable, writing
from runtime.shell.plain_text import is_plain
from runtime.signing import keys
from runtime.signing.pack import Pack, read, signed, verified
from runtime.table import load

NAME = "grasp-evidence"
EXIT_CODES = epilog(ExitCode.INPUT, ExitCode.SIGNATURE)
EPILOG = f"""\
examples:
  {NAME} key -o acme.pem
  {NAME} pack T.msgpack -o T.zip --calibration gripper.json --key acme.pem
  {NAME} verify T.zip --key acme.pem.pub

{EXIT_CODES}"""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    return run(parser(), argv, lambda arguments: int(arguments.run(arguments)))


def parser() -> Parser:
    """Builds the argument parser of `grasp-evidence`."""
    text = "Sign a table with its calibration and job, and check that nothing was changed since."
    built = Parser(prog=NAME, description=text, epilog=EPILOG)
    subcommands = built.add_subparsers(required=True, metavar="key | pack | verify")
    add = _add_subcommand(subcommands, "key -o acme.pem", _key, "make a key to sign with")
    text = (
        "private key, for its owner alone; the public one goes to K.pem.pub; neither is overwritten "
        "(default: ~/.config/squeezetree/signing-key.pem)"
    )
    add("-o", "--output", type=Path, metavar="K.pem", help=text)
    purpose = "sign a table, its calibration and its job as one zip"
    add = _add_subcommand(subcommands, "pack T.msgpack -o T.zip", _pack, purpose)
    add("tree", type=Path, metavar="T", help="the table, as plan-compile wrote it")
    add("-o", "--output", type=Path, required=True, metavar="P.zip", help="the pack, a new file")
    text = "calibration of the gripper that will run the table"
    add("--calibration", type=Path, metavar="F", help=text)
    text = "private key (default: that of grasp-evidence key, created if missing)"
    add("--key", type=Path, metavar="K.pem", help=text)
    add("--signer", type=_name, metavar="NAME", help="who signs, for people (default: user@host)")
    purpose = "check every byte of a pack; needs no network"
    add = _add_subcommand(subcommands, "verify T.zip --key acme.pem.pub", _verify, purpose)
    add("pack", type=Path, metavar="P.zip", help="the pack")
    text = "public key of the signer; without it the key in the pack is used, which does not prove who signed"
    add("--key", type=Path, metavar="K.pub", help=text)
    return built


def _add_subcommand(
    subcommands: Commands, example: str, body: Body, purpose: str
) -> Callable[..., object]:
    """Adds a subcommand; returns the method `add_argument` of its parser.

    Args:
        subcommands: the subcommands of `grasp-evidence`.
        example: a command line for --help, without the command's name.
        body: function that the subcommand runs.
        purpose: a phrase for --help.
    """
    subcommand = add_command(subcommands, purpose, f"{NAME} {example}", EXIT_CODES)
    subcommand.add_common()
    subcommand.set_defaults(run=body)
    return subcommand.add_argument


def _key(arguments: argparse.Namespace) -> int:
    path = arguments.output or _default_key()
    fingerprint, public = keys.generate(path).public.fingerprint, keys.public_of(path)
    fields = {"key": str(path), "public": str(public), "fingerprint": fingerprint}
    lines = (
        f"{path}: private key, keep it where the signer alone can read it",
        f"{public}: public key, for verify and --require-signed",
        f"fingerprint {fingerprint}",
    )
    say_result(arguments.json, fields, lines)
    return 0


def _pack(arguments: argparse.Namespace) -> int:
    output = usable(arguments.output, arguments.tree, arguments.calibration, arguments.key)
    if output.suffix != ".zip":
        raise OutputError(f"{output}: a cell looks for packs in files that end in .zip; name it so")
    if output.exists():
        raise OutputError(f"{output} exists, and a pack is never overwritten; name another file")
    table, path = load(arguments.tree), arguments.calibration
    measured = None if path is None else calibration.load(path).data
    key = _signing_key(arguments.key)
    signer, created = arguments.signer or _person(), SystemClock().stamp()
    facts = {"signer": signer, "created": created, "versions": _versions()}
    data = signed(table, measured, key, facts)
    pack = verified(data, key.public)
    with writing(output) as draft:
        draft.write_bytes(data)
    lines = (
        f"{output}: {', '.join(pack.members)}",
        f"signed by {pack.manifest['signer']}, fingerprint {pack.key.fingerprint}",
    )
    say_result(arguments.json, {"pack": str(output), **pack.fields()}, lines)
    return 0


def _verify(arguments: argparse.Namespace) -> int:
    trusted = None if arguments.key is None else keys.load_public(arguments.key)
    try:
        pack = verified(read(arguments.pack), trusted)
    except PackError as error:
        raise PackError(f"pack {arguments.pack}: {error}") from error
    checked = None if arguments.key is None else str(arguments.key)
    fields = {"pack": str(arguments.pack), "checked_against": checked, **pack.fields()}
    say_result(arguments.json, fields, _lines(arguments, pack))
    return 0


def _lines(arguments: argparse.Namespace, pack: Pack) -> list[str]:
    manifest = pack.manifest
    name = f"{manifest['signer']} on {manifest['created']}, fingerprint {pack.key.fingerprint}"
    if arguments.key is None:
        who = f"it says that it was signed by {name}; that was not checked against anyone (--key K.pub)"
    else:
        who = f"signed with {arguments.key} by {name}"
    digests = [f"  {digest}  {member}" for member, digest in manifest["sha256"].items()]
    return [f"{arguments.pack}: whole, every byte of it; {who}", *digests]


def _signing_key(given: Path | None) -> keys.SigningKey:
    """Loads the private key from the file `given`; for None, loads or creates the default key."""
    path = given or _default_key()
    if given is not None or path.exists():
        return keys.load_private(path)
    key = keys.generate(path)
    tell(NAME, f"made a key to sign with: {path}; others check by {keys.public_of(path)}")
    return key


def _default_key() -> Path:
    """Path of the default private key. Creates the key's folder, which only its owner may read."""
    home = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    path = Path(home) / "squeezetree" / "signing-key.pem"
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{path.parent} cannot be created: {error.strerror}; name a key's file instead"
        ) from error
    return path


def _versions() -> dict[str, str]:
    """The versions of squeezetree, Python and the runtime's dependencies, by name, to state in a pack."""
    from importlib import metadata

    versions = {"squeezetree": VERSION, "python": sys.version.split()[0]}
    for name in ("msgpack", "pymodbus", "pyserial"):
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return versions


def _person() -> str:
    try:
        user = getuser()
    except (OSError, KeyError):  # of a user id without a name
        user = "somebody"
    return f"{user}@{socket.gethostname()}"


def _name(text: str) -> str:
    if not is_plain(text):
        raise argparse.ArgumentTypeError(f"{text!r} is no name on one line")
    return text


if __name__ == "__main__":
    sys.exit(main())
