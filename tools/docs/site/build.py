"""Builds the documentation with warnings as errors, runs its notebooks and checks every link."""

import argparse
import os
import shutil
import sys
import tempfile
from pathlib import Path

from sphinx.cmd.build import main as sphinx

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
sys.path.insert(0, str(HERE))

import links  # noqa: E402

STRICT = ["--fail-on-warning", "--keep-going", "--nitpicky", "--fresh-env", "--quiet"]
STRICT += ["--conf-dir", str(HERE)]


def quiet_kernels(folder: Path) -> None:
    """Configures the kernels of notebooks to ignore the user's settings and to log nothing about sockets."""
    os.environ["IPYTHONDIR"] = str(folder)
    (folder / "profile_default").mkdir()
    (folder / "profile_default" / "ipython_kernel_config.py").write_text(
        "import logging\n"
        "c.IPKernelApp.log_level = 'ERROR'\n"
        # Sockets may close before the last flush.
        "logging.getLogger('tornado.general').setLevel(logging.CRITICAL)\n"
    )


def built(builder: str, cache: str, output: str) -> int:
    """Runs a builder of Sphinx; returns the exit status."""
    return sphinx([*STRICT, "--builder", builder, "--doctree-dir", cache, str(ROOT), output])


def main() -> int:
    parser = argparse.ArgumentParser(prog="tools/site", description=__doc__)
    add = parser.add_argument
    add("-o", "--output", type=Path, default=ROOT / "out" / "site", help="default: out/site")
    add("--links", action="store_true", help="also fetch every external page that is linked to")
    arguments = parser.parse_args()
    output: Path = arguments.output
    if output.exists() and not (output / "objects.inv").exists() and any(output.iterdir()):
        parser.error(f"{output} holds files that are not of a site; name another folder")
    shutil.rmtree(output, ignore_errors=True)
    with tempfile.TemporaryDirectory() as cache:
        quiet_kernels(Path(cache))
        status = built("html", cache, str(output))
        if status == 0 and arguments.links:
            status = built("linkcheck", cache, f"{cache}/links")
    if status:
        return 1
    result = links.check(output)
    for fault in result.faults:
        print(fault, file=sys.stderr)
    fetched = "all there" if arguments.links else "not fetched"
    print(f"{len(result.outside)} pages outside are linked to, {fetched}:")
    print("\n".join(f"  {address}" for address in result.outside))
    print(f"wrote {output / 'index.html'}")
    return 1 if result.faults else 0


if __name__ == "__main__":
    sys.exit(main())
