"""With each process frozen in turn, every command ends within its timeout and 0.2 s, correctly."""

import json
import os
import select
import shlex
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile

import pytest

from quadctl.cli.commands import COMMANDS
from tests.golden.shapes import ZONE
from tests.support.command_line import command_of
from tests.support.frozen import (
    ELSEWHERE,
    ENDINGS,
    FREEZABLE,
    FRESH,
    LINES,
    STREAM_TIMEOUT,
    STREAMS,
    TIMEOUT,
    Line,
)
from tests.support.lab import Lab, private_lab
from tests.support.proofs import Proofs
from tests.support.running import Done, eventually, is_frozen

SLACK = 0.2
"""Seconds that a command may wait beyond its timeout, without the start of Python."""
LONGEST_START = 0.6
"""Seconds of work that are not counted as waiting; most of it is the start of Python."""
LONGEST = 20.0
"""Seconds until a command hangs. The everyday test shows that it ends, not how promptly."""
NAMES = {2: "usage", 3: "unreachable", 4: "timeout", 5: "refused", 7: "already_served"}
RECORDING = Path(__file__).parents[1] / "recording" / "data" / "cage.mcap"


def test_every_command_is_in_a_table():
    lines = [line.words for line in (*LINES, *STREAMS, *ENDINGS)]
    named = {command_of(words) for words in lines}
    assert named | set(ELSEWHERE) == set(COMMANDS)
    assert not named & set(ELSEWHERE)


@pytest.fixture(scope="module")
def patient() -> Iterator[Lab]:
    """Flying system with a supervisor that does not kill frozen processes."""
    with patient_lab() as made:
        yield made


@pytest.mark.parametrize("who", FREEZABLE)
def test_commands_end_in_time_right_after_a_freeze(patient: Lab, who: str):
    with frozen(patient, who):
        for line in LINES:
            if line.words in FRESH[who]:
                run_and_check(patient, line, who)


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.parametrize("who", ["", *FREEZABLE])
def test_commands_end_in_time_after_the_hub_dropped_a_process(
    patient: Lab, proofs: Proofs, who: str
):
    with frozen(patient, who):
        if who in {"dynamics", "pressure", "safety"}:
            with patient.bare() as bare:
                eventually(lambda: who not in bare.nodes())
        late = {line.words: run_and_check(patient, line, who) - TIMEOUT for line in LINES}
    worst = max(late, key=lambda words: late[words])
    proofs.add(
        f"commands with {who or 'nobody'} frozen: end, after their timeout, at most",
        f"{1000 * max(late[worst], 0):.0f} ms (`{worst}`, n {len(LINES)})",
        f"{1000 * SLACK:.0f} ms",
    )
    assert late[worst] <= SLACK, (who, worst)


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.parametrize("who", FREEZABLE)
@pytest.mark.parametrize("line", STREAMS, ids=lambda line: line.words)
def test_a_stream_ends_in_time_when_a_process_freezes(patient: Lab, line: Line, who: str):
    words = shlex.split(line.words)
    run = patient.spawn(*patient.command(*words, "--timeout", STREAM_TIMEOUT))
    eventually(lambda: run.log or "pub" in words)
    if "pub" in words:
        with patient.bare() as bare:
            bare.watch("nobodys/own").next()
    with frozen(patient, who):
        began = clock(run.pid)
        if line.expected(who) == 130:
            assert not ends(run.pid, 2 * STREAM_TIMEOUT)
            run.send(signal.SIGINT)
            began = clock(run.pid) - STREAM_TIMEOUT
        assert ends(run.pid, LONGEST)
        waited = clock(run.pid) - began
        assert run.wait() == line.expected(who), run.log
        assert line.expected(who) == 0 or waited < STREAM_TIMEOUT + SLACK, run.log
        assert line.expected(who) != 4 or says_frozen(run.log)
    assert patient.quadctl("reset").code == 0


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.parametrize("who", FREEZABLE)
def test_commands_that_end_processes_work_with_one_frozen(who: str):
    with patient_lab() as lab:
        with frozen(lab, who, heal=False):
            for line in ENDINGS:
                code = line.expected(who)
                done = lab.quadctl(*line.words.split(), "--timeout", 10 if code == 0 else TIMEOUT)
                assert done.code == code, (line, done)
        eventually(lab.is_gone)


@contextmanager
def patient_lab() -> Iterator[Lab]:
    with private_lab() as made:
        # A goal waits for a pose as long as a flight may be paused, which must be within TIMEOUT.
        made.start("--set", "supervise.answer_timeout=60", "--set", "dynamics.grace=0.4")
        made.file("[pressure]\nnoise = 2e-5\n")
        made.file("", "saved.toml")
        made.file(ZONE, "zone.toml")
        made.file('rows = [{ at = 0.05, do = "hold" }]\nend = 0.1', "mission.toml")
        shutil.copy(RECORDING, made.folder / "flight.mcap")
        eventually(lambda: made.quadctl("goto", 0, 0, 1).code == 0)
        yield made


@contextmanager
def frozen(lab: Lab, who: str, *, heal: bool = True) -> Iterator[None]:
    """Freeze one process for the block; afterwards, if `heal`, wait until the run is healthy again."""
    status = lab.status()
    pids = {node["name"]: node["pid"] for node in status["nodes"]} | {"up": status["pid"]}
    if who:
        os.kill(pids[who], signal.SIGSTOP)
        eventually(lambda: is_frozen(pids[who]))
    try:
        yield
    finally:
        # `down` or `node restart` may have ended it.
        if who and os.path.exists(f"/proc/{pids[who]}"):  # noqa: PTH110 - shorter
            os.kill(pids[who], signal.SIGCONT)
    if heal:
        eventually(lambda: lab.quadctl("node", "ping", "--all", "-n", 1).code == 0)
        eventually(lambda: lab.quadctl("goto", 0, 0, 1).code == 0)


def timed(lab: Lab, words: str) -> tuple[Done, float]:
    """Run a command; return its output and the s it waited: its lifetime less its work.

    Starting Python is work, and so is waiting for a core.
    """
    line = lab.command(*shlex.split(words), "--timeout", TIMEOUT, "--json")
    with TemporaryFile("w+") as out, TemporaryFile("w+") as err:
        began = time.monotonic()
        process = subprocess.Popen(
            line,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            env=lab.environment,
            cwd=lab.folder,
        )
        assert ends(process.pid, LONGEST), words
        waited = clock(process.pid) - began
        process.wait()
        out.seek(0)
        err.seek(0)
        return Done(process.returncode, out.read(), err.read()), waited


def clock(pid: int) -> float:
    """Return the time (s) less the work of a child."""
    return time.monotonic() - at_work(pid)


def at_work(pid: int) -> float:
    """Return the s that a child's first thread ran, up to LONGEST_START, or waited for a core.

    Its other threads and the processes that it calls wait in the same queue, so waiting counts twice.
    """
    ran, queued, _ = Path(f"/proc/{pid}/schedstat").read_text(encoding="utf-8").split()
    return min(int(ran) / 1e9, LONGEST_START) + 2 * int(queued) / 1e9


def run_and_check(lab: Lab, line: Line, who: str) -> float:
    """Run a command, check it against the table, and return the s it waited."""
    (lab.folder / "quad.toml").unlink(missing_ok=True)
    done, waited = timed(lab, line.words)
    code = line.expected(who)
    assert done.code == code, (who, line.words, done)
    for row in done.out.splitlines():
        json.loads(row)
    if code in NAMES:
        assert done.error["code"] == NAMES[code], (who, line.words, done)
        assert "`quadctl up" not in done.err, (who, line.words, done)
    if code == 4:
        assert says_frozen(done.err), (who, line.words, done)
    if code == 4 and who == "hub":
        told = f"the realm {lab.realm} is up, but its hub did not answer within {TIMEOUT:g} s"
        assert done.error["message"] == told
    return waited


def says_frozen(text: str) -> bool:
    return "frozen" in text and "`quadctl" in text


def ends(pid: int, within: float) -> bool:
    """Wait for the end of a child, without the polling interval of Popen; return whether it ended."""
    descriptor = os.pidfd_open(pid)
    try:
        return bool(select.select([descriptor], [], [], within)[0])
    finally:
        os.close(descriptor)
