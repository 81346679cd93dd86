"""docs/how-to/many-machines.md, executed: each block of commands on the machine that it names."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.support.lab import Lab, private_lab
from tests.support.namespaces import Machine, three_machines
from tests.support.page_blocks import Command, blocks, commands, fits

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "many-machines.md"
SCP = """#!/bin/sh
while case "$1" in -*) true;; *) false;; esac; do shift; done
exec cp -r "$1" "{places}/${{2%%:*}}/${{2#*:}}"
"""
"""Substitute for scp: there is no ssh between the machines of a test."""


class Step(NamedTuple):
    machine: str
    command: Command


def steps() -> list[Step]:
    """Return the commands of the page in order, each with its machine."""
    console = [block for block in blocks(PAGE) if block.language == "console"]
    return [Step(block.info, command) for block in console for command in commands(block)]


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


@pytest.mark.thorough
@pytest.mark.needs("ip", "namespaces")
def test_the_commands_of_the_page_print_the_shown_output(
    places: dict[str, tuple[Machine, Lab]], tmp_path: Path
):
    said: dict[str, dict[str, str]] = {name: {} for name in places}
    to_run = steps()
    assert len(to_run) > 25
    for where, (line, shown) in to_run:
        machine, lab = places[where]
        if line.startswith("export "):
            name, _, value = line.removeprefix("export ").partition("=")
            said[where][name] = value
            continue
        path = os.pathsep.join(
            (str(tmp_path), str(Path(sys.executable).parent), os.environ["PATH"])
        )
        done = subprocess.run(
            [*machine.enter, "/bin/sh", "-c", line],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=30,
            env=lab.environment | said[where] | {"PATH": path},
            cwd=lab.folder,
            check=False,
        )
        assert fits(shown, done.stdout), f"{line}\n{done.stdout}"
        assert (done.returncode == 0) is not shown.startswith("error: "), line
