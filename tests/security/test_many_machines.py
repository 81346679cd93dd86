"""docs/how-to/many-machines.md, executed: each block of commands on the machine that it names."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.support.lab import Lab, private_lab
from tests.support.namespaces import Machine, three_machines

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "many-machines.md"
BLOCK = re.compile(r"^```console (\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SCP = """#!/bin/sh
while case "$1" in -*) true;; *) false;; esac; do shift; done
exec cp -r "$1" "{places}/${{2%%:*}}/${{2#*:}}"
"""
"""Substitute for scp: there is no ssh between the machines of a test."""


class Step(NamedTuple):
    machine: str
    command: str
    output: str


def steps() -> list[Step]:
    """Return the commands of the page in order, each with the output below it."""
    found = []
    for machine, text in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        for part in text.split("\n$ ") if text.startswith("$ ") else []:
            command, _, output = part.removeprefix("$ ").partition("\n")
            found.append(Step(machine, command, output.rstrip("\n")))
    return found


def fits(shown: str, said: str) -> bool:
    """Return whether an output matches the shown one; `...` matches anything."""
    parts = (re.escape(part) for part in re.split(r"\.\.\.(?!\.)", shown))
    return re.fullmatch(".*".join(parts), said.rstrip("\n"), re.DOTALL) is not None


@pytest.fixture
def places(tmp_path: Path) -> Iterator[dict[str, tuple[Machine, Lab]]]:
    with ExitStack() as held:
        student, teacher, laptop = held.enter_context(three_machines())
        # The teacher's machine forwards packets between the others, like a router.
        forward = "echo 1 > /proc/sys/net/ipv4/ip_forward"
        subprocess.run([*teacher.enter, "/bin/sh", "-c", forward], check=True)
        student.ip("route", "add", "default", "via", "10.7.1.1")
        laptop.ip("route", "add", "default", "via", "10.7.2.1")
        machines = {"teacher": teacher, "student": student, "laptop": laptop}
        labs = {
            name: (machine, held.enter_context(private_lab(machine.enter)))
            for name, machine in machines.items()
        }
        for name, (_, lab) in labs.items():
            (tmp_path / name).symlink_to(lab.folder)
        scp = tmp_path / "scp"
        scp.write_text(SCP.format(places=tmp_path), encoding="utf-8")
        scp.chmod(0o755)
        yield labs


@pytest.mark.needs("ip", "namespaces")
def test_the_commands_of_the_page_print_the_shown_output(
    places: dict[str, tuple[Machine, Lab]], tmp_path: Path
):
    said: dict[str, dict[str, str]] = {name: {} for name in places}
    to_run = steps()
    assert len(to_run) > 25
    for step in to_run:
        machine, lab = places[step.machine]
        if step.command.startswith("export "):
            name, _, value = step.command.removeprefix("export ").partition("=")
            said[step.machine][name] = value
            continue
        path = os.pathsep.join(
            (str(tmp_path), str(Path(sys.executable).parent), os.environ["PATH"])
        )
        done = subprocess.run(
            [*machine.enter, "/bin/sh", "-c", step.command],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=30,
            env=lab.environment | said[step.machine] | {"PATH": path},
            cwd=lab.folder,
            check=False,
        )
        assert fits(step.output, done.stdout), f"{step.command}\n{done.stdout}"
        assert (done.returncode == 0) is not step.output.startswith("error: "), step.command
