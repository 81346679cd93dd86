"""The files in deploy/: their commands, signals and lists of files, as far as no Docker and systemd run here."""

import configparser
import json
import re
import shlex
import shutil
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.support.lab import Lab
from tests.support.running import eventually

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"


def instructions() -> dict[str, str]:
    """Return the last value of each instruction of the Dockerfile."""
    text = (DEPLOY / "Dockerfile").read_text("utf-8").replace("\\\n", " ")
    found = (line.partition(" ") for line in text.splitlines() if re.match(r"[A-Z]+ ", line))
    return {name: value.strip() for name, _, value in found}


def unit() -> configparser.SectionProxy:
    """Return the service section; of a key that is there several times, the last value."""
    found = configparser.RawConfigParser(strict=False, interpolation=None)
    found.optionxform = str  # type: ignore[assignment,method-assign]
    found.read(DEPLOY / "quadctl.service", "utf-8")
    assert found.sections() == ["Unit", "Service", "Install"]
    return found["Service"]


def given() -> list[str]:
    """Return the files and folders that the image is built from."""
    lines = (ROOT / ".dockerignore").read_text("utf-8").splitlines()
    return [line[1:] for line in lines if line.startswith("!")]


def commands() -> dict[str, tuple[list[str], int]]:
    """Return the command that each file starts, and the signal that ends it."""
    docker, service = instructions(), unit()
    image = json.loads(docker["ENTRYPOINT"]) + json.loads(docker["CMD"])
    started = [Path(service["ExecStart"].split()[0]).name, *service["ExecStart"].split()[1:]]
    return {
        "image": (image, signal.Signals[docker["STOPSIGNAL"]]),
        "unit": (started, signal.Signals[service["KillSignal"]]),
    }


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["image", "unit"])
def test_the_command_flies_answers_the_health_check_and_ends_cleanly(lab: Lab, name: str):
    (program, *words), number = commands()[name]
    assert program == "quadctl"
    run = lab.spawn(*lab.command(*(word.replace("%i", lab.realm) for word in words)))
    eventually(lab.is_ready)
    program, *check = json.loads(instructions()["HEALTHCHECK"].partition("CMD ")[2])
    assert program == "quadctl"
    assert lab.quadctl(*check).code == 0
    run.send(number)
    assert run.wait() == 0
    assert lab.is_gone()
    assert lab.quadctl(*check).code == 3


@pytest.mark.thorough
def test_the_unit_restarts_no_wrong_command_line_or_parameter(lab: Lab):
    prevented = [int(code) for code in unit()["RestartPreventExitStatus"].split()]
    assert lab.quadctl("up", "--nothing").code in prevented
    assert lab.quadctl("up", "--set", "safety.takeof=1").code in prevented


@pytest.mark.thorough
def test_the_image_has_all_files_of_the_package_and_no_other(tmp_path: Path):
    source = tmp_path / "src"
    for name in given():
        assert (ROOT / name).exists(), name
        target = source / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, target, symlinks=True)
        else:
            shutil.copy(ROOT / name, target)
    for line in re.findall(
        r"^COPY (?!--from)(.+)$", (DEPLOY / "Dockerfile").read_text("utf-8"), re.MULTILINE
    ):
        for name in shlex.split(line)[:-1]:
            assert (source / name).exists(), name
    whole = tmp_path / "whole"
    for folder, out in ((source, tmp_path / "wheel"), (ROOT, whole)):
        subprocess.run(
            [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", out, folder],
            check=True, capture_output=True,
        )  # fmt: skip
    names = [
        sorted(zipfile.ZipFile(next(out.glob("*.whl"))).namelist())
        for out in (tmp_path / "wheel", whole)
    ]
    assert names[0] == names[1]
