"""Grading of hand-ins: each in a process of its own, in a sandbox, several at a time."""

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import IO, Any

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from quadctl.cli.lab.formats import Grade
from quadctl.cli.lab.handin import HandIn, encodable, nodes_in, unpacked
from quadctl.cli.lab.judge import NOT_FLOWN, RowResult, fly
from quadctl.cli.lab.machine import Limits, Machine
from quadctl.cli.lab.rubric import Rubric, rubric
from quadctl.cli.temporary_run import leaving
from quadctl.schemas.typed import from_json
from quadctl.services.runtime.errors import Invalid, QuadctlError
from quadctl.services.runtime.realm import Realm

AFTER_LOSS = "not flown: another row does not hold"
_LAST = 1.0
"""Seconds for a judge to end after its last result."""
_END = 10.0
"""Seconds beyond its limit in which the process of a hand-in may end by itself."""


class GradingJob(Struct, frozen=True):
    """Hand-in to be flown: folder, one for its copies, commands of its nodes, rubric's tables, limits.

    `machine` has the means to shut it in, `group` is its control group or empty. `evidence` is a
    folder for logs and a recording, or empty. With `first_loss` the first row that does not hold is the last one flown.
    """

    folder: str
    root: str
    nodes: dict[str, list[str]]
    tables: dict[str, Any]
    limits: Limits
    machine: Machine
    group: str
    evidence: str = ""
    first_loss: bool = False


class _Judges:
    """Processes that fly hand-ins at present."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[bytes]] = set()
        self._ended = False

    @contextmanager
    def running(self, process: subprocess.Popen[bytes]) -> Iterator[None]:
        """Keep a process among them for the block, and end it with the block; its run ends with it."""
        self._running.add(process)
        if self._ended:
            process.kill()
        try:
            yield
        finally:
            process.kill()
            self._running.discard(process)

    def end(self) -> None:
        """End them, and those that are yet to come."""
        self._ended = True
        for process in list(self._running):
            process.kill()


def grade(
    handins: Sequence[HandIn],
    tables: dict[str, Any],
    limits: Limits,
    *,
    jobs: int,
    machine: Machine,
    on_done: Callable[[Grade], None],
    on_row: Callable[[RowResult], None] = lambda _result: None,
    keep: Callable[[HandIn, Path], None] | None = None,
    first_loss: bool = False,
) -> list[Grade]:
    """Return the grades, in the order of the hand-ins; call `on_done` with each as it is done.

    A hand-in that cannot be graded, whatever the reason, is reported as that, and the others are graded. `on_row`
    is called with each result, in this thread as `on_done` is; `keep` in the thread of a hand-in, with the folder of
    its logs and its recording, before that goes. With `first_loss` a hand-in is flown up to the first row that does
    not hold.
    """
    made, judges = rubric(tables, "the rubric"), _Judges()
    events: SimpleQueue[RowResult | Future[Grade]] = SimpleQueue()

    def one(handin: HandIn) -> Grade:
        began, results, why = time.monotonic(), list[RowResult](), ""
        try:
            with (
                tempfile.TemporaryDirectory(
                    prefix="quadctl-lab-", ignore_cleanup_errors=True
                ) as own,
                machine.control_group(limits) as group,
            ):
                evidence = Path(own, "evidence")
                if keep:
                    evidence.mkdir(mode=0o700)
                job = _job(handin, Path(own), tables, limits, machine, group)
                job = replace(job, evidence=str(evidence) if keep else "", first_loss=first_loss)
                results = _flown(job, made, judges, events.put)
                if keep:
                    keep(handin, evidence)
            if any(each.output == NOT_FLOWN for each in results):
                why = f"it took more than {limits.wall:g} s here; grade it again, with a larger --wall"
        except QuadctlError as problem:
            why = "; try: ".join(filter(None, (problem.message, problem.hint)))
        except Exception as error:  # noqa: BLE001 - whatever it is, it must not cost the others' marks
            why = f"internal error: {type(error).__name__}: {error}; try: grade it by itself"
        why = encodable(" ".join(why.split()))
        return Grade(handin.name, results or _all(made, [], why), time.monotonic() - began, why)

    with leaving() as stay, ThreadPoolExecutor(jobs) as pool:
        futures = [pool.submit(one, handin) for handin in handins]
        try:
            for future in futures:
                future.add_done_callback(events.put)
            left = len(futures)
            while left:
                event = events.get()
                if isinstance(event, RowResult):
                    on_row(event)
                else:
                    left -= 1
                    on_done(event.result())
        except BaseException:
            # After Ctrl-C nothing flies on.
            stay()
            pool.shutdown(wait=False, cancel_futures=True)
            judges.end()
            raise
        return [future.result() for future in futures]


def _job(
    handin: HandIn,
    own: Path,
    tables: dict[str, Any],
    limits: Limits,
    machine: Machine,
    group: str,
) -> GradingJob:
    """Copy a hand-in to a folder for us alone, and return the job of flying it."""
    copies, root = own / "handin", own / "root"
    for each in (copies, root):
        each.mkdir(mode=0o700)
    folder = unpacked(handin, copies)
    try:
        nodes = nodes_in(folder)
    except Invalid as problem:
        # The folder is gone when this is read.
        raise Invalid(problem.message.replace(f"{folder}{os.sep}", ""), problem.hint) from problem
    return GradingJob(str(folder), str(root), nodes, tables, limits, machine, group)


def _all(made: Rubric, results: list[RowResult], why: str) -> list[RowResult]:
    """Return a result for each row, in the order of the rubric; rows without one failed, why."""
    found = {result.name: result for result in results}
    return [found.get(row.name) or RowResult.without_flight(row, why) for row in made.rows]


def _flown(
    job: GradingJob, made: Rubric, judges: _Judges, on_row: Callable[[RowResult], None]
) -> list[RowResult]:
    """Fly a hand-in in a process of its own; its end, whatever its cause, costs only its own rows."""
    command = (sys.executable, "-P", "-m", "quadctl.cli.lab.grading")
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            start_new_session=True,
        ) as process,
        judges.running(process),
    ):
        assert process.stdin is not None  # noqa: S101 - pipes, see above
        assert process.stdout is not None  # noqa: S101
        process.stdin.write(msgspec.json.encode(job) + b"\n")
        process.stdin.flush()
        results = list[RowResult]()
        for result in _results(process.stdout, job.limits.wall + _END):
            results.append(result)
            on_row(result)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_LAST)
        code = process.returncode
        errors.seek(0)
        last = errors.read().decode(errors="replace").splitlines()[-1:]
    failed = f"not flown: its judge failed: {last[0]}" if code and last else NOT_FLOWN
    if job.first_loss and results and not results[-1].ok:
        failed = AFTER_LOSS
    return _all(made, results, failed)


def _results(pipe: IO[bytes], seconds: float) -> Iterator[RowResult]:
    """Yield the results that a process reports, until its end, or for so many seconds."""
    # Windows can only wait for a pipe in a thread.
    lines: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_read, args=(pipe, lines.put), daemon=True).start()
    until = time.monotonic() + seconds
    with suppress(Empty):
        while (line := lines.get(timeout=max(until - time.monotonic(), 0))).endswith(b"\n"):
            yield from_json(line, RowResult)


def _read(pipe: IO[bytes], put: Callable[[bytes], None]) -> None:
    for line in pipe:
        put(line)
    put(b"")


def main() -> None:
    """Fly the job from stdin, and write a line for each row."""
    job = from_json(sys.stdin.buffer.readline(), GradingJob)
    folder, root = Path(job.folder), Path(job.root)

    def wrap(realm: Realm, command: list[str]) -> list[str]:
        return job.machine.shut_in(command, folder, realm.folder, root, job.limits, job.group)

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the grader ends us
    made = rubric(job.tables, "the rubric")
    until = time.monotonic() + job.limits.wall
    evidence = Path(job.evidence) if job.evidence else None
    with job.machine.without_orphans():
        for result in fly(folder, job.nodes, made, until=until, wrap=wrap, evidence=evidence):
            sys.stdout.buffer.write(msgspec.json.encode(result) + b"\n")
            sys.stdout.buffer.flush()
            if job.first_loss and not result.ok:
                break


if __name__ == "__main__":
    main()
