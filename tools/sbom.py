"""Writes a bill of materials (CycloneDX 1.6, JSON) of a folder of wheels: `python tools/sbom.py out/wheels`.

The bill is the file `sbom.cdx.json` beside the wheels. It lists each wheel with its SHA-256, version, licence
and dependencies. `tools/wheel` calls this script.
"""

import hashlib
import sys
import zipfile
from email.message import Message
from email.parser import BytesParser
from pathlib import Path
from typing import NamedTuple

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import HashAlgorithm, HashType
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from packageurl import PackageURL
from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name

ROOT = "squeezetree"
NAME = "sbom.cdx.json"


class Wheel(NamedTuple):
    """A wheel as an entry of the bill."""

    component: Component
    needs: tuple[str, ...]  # canonical names of the packages that it requires


def read(path: Path) -> Wheel:
    """Reads a wheel; returns its entry of the bill and its dependencies.

    Raises:
        ValueError: the file is no wheel.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            (inside,) = (
                name for name in archive.namelist() if name.endswith(".dist-info/METADATA")
            )
            metadata = BytesParser().parsebytes(archive.read(inside))
    except (zipfile.BadZipFile, ValueError) as error:
        raise ValueError(f"{path.name} is no wheel; run tools/wheel again") from error
    name, version = canonicalize_name(metadata["Name"]), metadata["Version"]
    licence, digest = licence_of(metadata), hashlib.sha256(path.read_bytes()).hexdigest()
    component = Component(
        type=ComponentType.APPLICATION if name == ROOT else ComponentType.LIBRARY,
        bom_ref=f"pkg:pypi/{name}@{version}",
        name=name,
        version=version,
        purl=PackageURL("pypi", name=name, version=version),
        description=metadata["Summary"],
        hashes=[HashType(alg=HashAlgorithm.SHA_256, content=digest)],
        licenses=[LicenseFactory().make_from_string(licence)] if licence else [],
    )
    return Wheel(component, tuple(_needs(metadata.get_all("Requires-Dist", []))))


def licence_of(metadata: Message) -> str:
    """The licence that a wheel states: SPDX expression, else free text, else classifier; "" if none."""
    words = [metadata["License-Expression"], metadata["License"]]
    words += [line for line in metadata.get_all("Classifier", []) if line.startswith("License ::")]
    lines = (word.strip().rpartition(" :: ")[2] for word in words if word)
    return next((line for line in lines if line and "\n" not in line), "")


def bill(wheels: list[Wheel]) -> str:
    """Returns the bill of materials as JSON.

    Raises:
        ValueError: the wheel of squeezetree is missing.
    """
    by_name = {wheel.component.name: wheel for wheel in wheels}
    if ROOT not in by_name:
        raise ValueError(f"there is no wheel of {ROOT}; run tools/wheel again")
    bom = Bom(components=[wheel.component for name, wheel in by_name.items() if name != ROOT])
    bom.metadata.component = by_name[ROOT].component
    for wheel in wheels:
        needed = [by_name[name].component for name in wheel.needs if name in by_name]
        bom.register_dependency(wheel.component, needed)
    return JsonV1Dot6(bom).output_as_string(indent=1)


def _needs(requirements: list[str]) -> list[str]:
    """Canonical names of all required packages, also of extras; `bill` leaves out those without a wheel."""
    names = set()
    for text in requirements:
        try:
            names.add(canonicalize_name(Requirement(text).name))
        except InvalidRequirement:  # of an old tool; the wheel is listed all the same
            continue
    return sorted(names)


def main(folder: Path) -> int:
    """Writes the bill of a folder; returns the exit code."""
    try:
        text = bill([read(path) for path in sorted(folder.glob("*.whl"))])
        (folder / NAME).write_text(text + "\n", encoding="utf-8")
    except (ValueError, OSError) as error:
        print(f"tools/sbom.py: {error}", file=sys.stderr)
        return 1
    print(f"{folder / NAME}: what the wheels are, with digests, versions and licences")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
