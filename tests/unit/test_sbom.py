"""The bill of materials of a folder of wheels: valid CycloneDX with the digest of each wheel."""

import hashlib
import json
import zipfile

import pytest
import sbom
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

LINES = {
    "squeezetree-0.1.0": [
        "Requires-Dist: msgpack>=1.1",
        "Requires-Dist: numpy; extra == 'planner'",
    ],
    "msgpack-1.1.2": ["License-Expression: Apache-2.0", "Summary: MessagePack"],
    "odd_name-2": ["License: BSD 3-Clause License", "Requires-Dist: not a requirement !"],
    "classified-3": ["Classifier: License :: OSI Approved :: MIT License"],
    "custom-4": ["License-Expression: Custom Terms No 1"],
}


@pytest.fixture
def wheels(tmp_path):
    for stem, lines in LINES.items():
        name, _, version = stem.rpartition("-")
        head = ["Metadata-Version: 2.4", f"Name: {name}", f"Version: {version}"]
        text = "\n".join([*head, *lines, "", ""])
        with zipfile.ZipFile(tmp_path / f"{stem}-py3-none-any.whl", "w") as archive:
            archive.writestr(f"{stem}.dist-info/METADATA", text)
    return tmp_path


def test_sbom_of_wheels_is_valid_and_lists_each_with_its_digest(wheels):
    assert sbom.main(wheels) == 0
    text = (wheels / sbom.NAME).read_text()
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    record = json.loads(text)
    assert record["metadata"]["component"]["name"] == "squeezetree"
    parts = [*record["components"], record["metadata"]["component"]]
    listed = {part["name"]: part for part in parts}
    assert set(listed) == {"squeezetree", "msgpack", "odd-name", "classified", "custom"}
    for path in wheels.glob("*.whl"):
        (digest,) = listed[path.name.partition("-")[0].replace("_", "-")]["hashes"]
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        assert digest == {"alg": "SHA-256", "content": content}
    needed = {line["ref"]: line.get("dependsOn", []) for line in record["dependencies"]}
    assert needed["pkg:pypi/squeezetree@0.1.0"] == ["pkg:pypi/msgpack@1.1.2"]
    assert all(part.get("licenses") for name, part in listed.items() if name != "squeezetree")


def test_sbom_broken_or_missing_squeezetree_wheel_is_refused(wheels, capsys):
    ours = wheels / "squeezetree-0.1.0-py3-none-any.whl"
    ours.write_bytes(b"PK")
    assert sbom.main(wheels) == 1
    assert f"{ours.name} is no wheel" in capsys.readouterr().err
    ours.unlink()
    assert sbom.main(wheels) == 1
    assert "there is no wheel of squeezetree" in capsys.readouterr().err
