"""`doctor` on broken installations, each made in a folder that Python searches first."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support.lab import Lab
from tests.support.running import DEADLINE

ROOT = Path(__file__).parents[2]


def ask(lab: Lab, **environment: str) -> dict[str, Any]:
    """Return the checks of a faulty installation, by name."""
    done = lab.quadctl("doctor", "--json", timeout=DEADLINE, **environment)
    assert (done.code, done.err) == (8, "")
    return {check["name"]: check for check in done.json["checks"]}


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("package", "files", "check", "said"),
    [
        ("numpy-1.0", {}, "packages", "numpy 1.0, needed <3,>=2.2"),
        ("quadctl-0.1.0", {"METADATA": "Requires-Python: >=4\n"}, "Python", "quadctl needs >=4"),
        ("other-1.0", {"top_level.txt": "quadctl\n"}, "imports", "quadctl is also in other"),
        (
            "quadctl-0.1.0",
            {"RECORD": "quadctl/cli/main.py,sha256=abc,1\n"},
            "imports",
            "quadctl/cli/main.py",
        ),
    ],
)
def test_doctor_finds_a_faulty_package(
    lab: Lab, package: str, files: dict[str, str], check: str, said: str
):
    name, _, version = package.partition("-")
    folder = lab.folder / "first" / f"{package}.dist-info"
    folder.mkdir(parents=True)
    metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    for file, text in ({"METADATA": ""} | files).items():
        (folder / file).write_text(
            (metadata if file == "METADATA" else "") + text, encoding="utf-8"
        )
    found = ask(lab, PYTHONPATH=str(folder.parent))
    assert found[check]["verdict"] == "FAIL"
    assert said in found[check]["evidence"]
    assert found[check]["fix"]


@pytest.mark.thorough
def test_doctor_finds_a_different_checkout_than_the_imported_one(lab: Lab):
    copy = lab.folder / "copy"
    shutil.copytree(ROOT / "src" / "quadctl", copy / "quadctl")
    done = subprocess.run(
        [sys.executable, "-m", "quadctl.cli.main", "doctor", "--json"],
        cwd=copy, env=lab.environment, capture_output=True, timeout=DEADLINE, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (8, b"")
    (imports,) = [c for c in json.loads(done.stdout)["checks"] if c["name"] == "imports"]
    assert imports["verdict"] == "FAIL"
    assert f"this is quadctl of {copy}" in imports["evidence"]
    assert f"quadctl from {ROOT / 'src'}" in imports["evidence"]


@pytest.mark.thorough
def test_doctor_finds_a_realm_path_that_is_too_long(lab: Lab):
    deep = lab.folder / ("deep" * 25)
    deep.mkdir()
    realm = ask(lab, XDG_RUNTIME_DIR=str(deep))["realm"]
    assert (realm["verdict"], "too long" in realm["evidence"]) == ("FAIL", True)
    assert "XDG_RUNTIME_DIR" in realm["fix"]
