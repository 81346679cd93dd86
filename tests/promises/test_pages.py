"""Command blocks of README and docs/: each runs unchanged, each page on a separate realm."""

import os
import re
import shutil
import signal
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from _pytest.mark.structures import ParameterSet

from tests.support.compiled import compiled_kernel
from tests.support.lab import Lab, private_lab
from tests.support.page_blocks import Block, Command, blocks, commands, fits
from tests.support.running import eventually

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
ELSEWHERE = {
    "many-machines.md": "needs three machines: tests/security/test_many_machines.py runs it",
}
EVERYDAY = "README.md"
"""Page whose blocks `make test` runs; the others are for `make test-all`."""
LEFT_OUT = {
    "make demo": "installs from the network",
    "make test": "is this run of the tests",
    "python3 -m venv .venv": "the test runs in an environment that is set up",
    ".venv/bin/pip install .": "installs from the network; tests/packaging builds and tries the wheel",
    ".venv/bin/quadctl demo": "takes 25 s; tests/flight/test_checkpoint_1.py to _4.py hold the same",
}
"""Commands that a test cannot run, each with the reason."""
NEEDS_SANDBOX = "quadctl lab grade "
"""Command that a machine without a complete sandbox refuses."""
FLIES_COMPILED = re.compile("quadctl (campaign|lab check|lab grade) ")
READ = {"console", "python", "toml", "text"}
"""Languages of blocks: `text` is not run, and the book draws no other, e.g. mermaid, offline."""
WITHIN = 240.0
"""s, for one command."""


@contextmanager
def reader() -> Iterator[Lab]:
    """A realm named `default` like a reader's, in a folder with the checkout's examples."""
    with private_lab() as lab:
        lab.realm = "default"
        lab.environment |= {
            "QUADCTL_REALM": lab.realm,
            "PATH": os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"])),
        }
        shutil.copy(ROOT / "quad.toml", lab.folder)
        shutil.copytree(ROOT / "examples", lab.folder / "examples")
        yield lab


def run(lab: Lab, command: Command) -> None:
    before, interrupted, after = command.output.partition("^C")
    with subprocess.Popen(
        ["/bin/sh", "-c", command.line],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=lab.environment,
        cwd=lab.folder,
        start_new_session=True,
    ) as process:
        printed = ""
        try:
            if interrupted:
                assert process.stdout is not None
                lines = [process.stdout.readline() for _ in before.splitlines()]
                assert fits(before, "".join(lines)), f"$ {command.line}\n{''.join(lines)}"
                os.killpg(process.pid, signal.SIGINT)
            printed, _ = process.communicate(timeout=WITHIN)
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)  # the failure must not wait for it
            raise
    assert fits(after if interrupted else command.output, printed), f"$ {command.line}\n{printed}"
    if not interrupted:
        failure = any(line.startswith("error: ") for line in command.output.splitlines())
        assert (process.returncode != 0) is failure, f"$ {command.line}\n{printed}"


def take(lab: Lab, block: Block) -> None:
    """Do what a reader does with a block: save it as its file, or run it."""
    if block.title:
        (lab.folder / block.title).write_text(block.text, encoding="utf-8")
    elif block.language == "python":
        file = lab.folder / "block.py"
        file.write_text(block.text, encoding="utf-8")
        run(lab, Command(f"python {file.name}", "..."))
    if block.language == "toml":
        tomllib.loads(block.text)
    if block.language == "console":
        for command in commands(block):
            if command.bare not in LEFT_OUT:
                run(lab, command)


def parameter(page: Path) -> ParameterSet:
    name = page.relative_to(ROOT).as_posix()
    marks = [] if name == EVERYDAY else [pytest.mark.thorough]
    if any(b.language == "console" and NEEDS_SANDBOX in b.text for b in blocks(page)):
        marks.append(pytest.mark.needs("sandbox"))
    return pytest.param(page, id=name, marks=marks)


@pytest.mark.parametrize(
    "page",
    [
        parameter(page)
        for page in PAGES
        if page.name not in ELSEWHERE and "```" in page.read_text("utf-8")
    ],
)
@pytest.mark.timeout(600)  # for a whole page: each command has its own limit, WITHIN
def test_the_blocks_of_a_page_run_in_order(page: Path):
    if any(b.language == "console" and FLIES_COMPILED.search(b.text) for b in blocks(page)):
        compiled_kernel()  # up to a minute on a busy machine, which is no command's own time
    with reader() as lab:
        for block in blocks(page):
            take(lab, block)
        eventually(lambda: not lab.processes(), describe=lambda: f"{page.name} left a run up")


def test_every_block_has_a_known_language():
    languages = {(page.name, b.language) for page in PAGES for b in blocks(page)}
    assert {(page, language) for page, language in languages if language not in READ} == set()


def test_every_command_left_out_is_on_a_page():
    shown = {
        command.bare
        for page in PAGES
        if page.name not in ELSEWHERE
        for block in blocks(page)
        if block.language == "console"
        for command in commands(block)
    }
    assert set(LEFT_OUT) - shown == set()
    assert set(ELSEWHERE) <= {page.name for page in PAGES}
    assert len(shown) > 50
    assert "make test" in shown


def test_a_command_with_a_wrong_output_fails(lab: Lab):
    run(lab, Command("echo a 1.5", "a 2.5"))
    with pytest.raises(AssertionError, match=r"\$ echo a 1"):
        run(lab, Command("echo a 1", "a 2"))
    with pytest.raises(AssertionError, match="false"):
        run(lab, Command("false", ""))


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("arrived within 0.46 m", "arrived within 0.4 m", True),
        ("1571 messages of 7 keys", "133 messages of 7 keys", True),
        ("1571 messages of 7 keys", "1571 messages of 8 keys", False),
        ("spread 2e-05 hPa", "spread 0.0001 hPa", True),
        ("x = 9 is beyond [-5, 5]", "x = 8 is beyond [-5, 5]", False),
        ("boot: ...\n...\nend", "boot: 1\nend", True),
        ("NAME  STATE", "NAME      STATE", True),
        ("accepted", "rejected", False),
        ("accepted\narrived", "accepted\npaused: no pose for 0.2 s\nwent on\narrived", True),
    ],
)
def test_numbers_that_vary_may_vary(shown: str, printed: str, same: bool):
    assert fits(shown, printed) is same
