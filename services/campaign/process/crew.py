"""The workers of a campaign, each a process on a core of its own, and the jobs they share."""

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator

import msgspec

from services.campaign.diary import Flown
from services.campaign.process.orders import Done, Job
from services.runtime.errors import QuadctlError

_COMMAND = (sys.executable, "-P", "-m", "services.campaign.process.worker")


class Worker:
    """One process that flies a job at a time."""

    def __init__(self) -> None:
        self._popen = subprocess.Popen(_COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def fly(self, job: Job) -> list[Flown]:
        """Raises QuadctlError where the worker ends instead."""
        assert self._popen.stdin is not None  # noqa: S101 - pipes, as asked for above
        assert self._popen.stdout is not None  # noqa: S101
        try:
            self._popen.stdin.write(msgspec.json.encode(job) + b"\n")
            self._popen.stdin.flush()
        except BrokenPipeError:
            pass  # what it was is told below
        line = self._popen.stdout.readline()
        if not line:
            code = self._popen.wait()
            raise QuadctlError(f"a worker of the campaign ended with code {code}", "see above")
        return msgspec.json.decode(line, type=Done).flown

    def end(self) -> None:
        """It ends where its stdin does."""
        self._popen.communicate()


class Crew:
    """Workers that take the next job as soon as they are done with one."""

    def __init__(self, jobs: list[Job], on_flown: Callable[[list[Flown]], None]) -> None:
        """`on_flown` is called with what came of each job, one after the other."""
        self._jobs: Iterator[Job] = iter(jobs)
        self._on_flown = on_flown
        self._lock = threading.Lock()
        self.problem: QuadctlError | None = None

    def fly(self, workers: list[Worker]) -> None:
        """Fly all jobs; raises QuadctlError where a worker ends."""
        threads = [threading.Thread(target=self._serve, args=(each,)) for each in workers]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        if self.problem:
            raise self.problem

    def _serve(self, worker: Worker) -> None:
        while True:
            with self._lock:
                job = next(self._jobs, None)
            if job is None or self.problem:
                return
            try:
                flown = worker.fly(job)
            except QuadctlError as problem:
                self.problem = problem
                return
            with self._lock:
                self._on_flown(flown)
