"""Worker processes of a campaign, and their JSON lines.

A worker exits at once when its stdin is closed, even in the middle of a batch: its parent has died.
"""

import gc
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from queue import SimpleQueue
from random import Random
from types import ModuleType
from typing import Any

import msgspec
from msgspec import Struct

from quadctl.schemas.params import DynamicsParams
from quadctl.schemas.typed import from_json
from quadctl.services.campaign import watch
from quadctl.services.campaign.batch import Batch, MakeFleet
from quadctl.services.campaign.mission import Conditions, Mission, missions
from quadctl.services.campaign.score import Flown
from quadctl.services.campaign.vehicles import Compiled, Plain, VehicleBatch
from quadctl.services.dynamics.compiled import kernel, source
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.filelock import turn


class Job(Struct, frozen=True):
    """Random flights with these seeds, for a worker; with none it only gets ready.

    Or these missions, for a search: the excursion of a flight that stays inside is then negative,
    its distance from the nearest wall.
    """

    first: int
    count: int
    conditions: Conditions
    missions: list[Mission] = []


def emit(value: Any) -> None:
    """Write one document, and flush."""
    sys.stdout.write(msgspec.json.encode(value).decode() + "\n")
    sys.stdout.flush()


_COMMAND = (sys.executable, "-P", "-m", "quadctl.services.campaign.workers")


class Worker:
    """Process that flies one job at a time."""

    def __init__(self) -> None:
        # In a folder that is there: numba looks at its own, and a user's may have been deleted.
        self._popen = subprocess.Popen(
            _COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd="/"
        )

    def fly(self, job: Job) -> list[Flown]:
        """Return the results of a job; raise QuadctlError if the worker exits instead."""
        assert self._popen.stdin is not None  # noqa: S101 - a pipe, see above
        assert self._popen.stdout is not None  # noqa: S101
        try:
            self._popen.stdin.write(msgspec.json.encode(job) + b"\n")
            self._popen.stdin.flush()
        except BrokenPipeError:
            pass  # reported below, by the missing line
        line = self._popen.stdout.readline()
        if not line.endswith(b"\n"):  # it ended before the line, or in the middle of it
            code = self._popen.wait()
            raise QuadctlError(f"a campaign worker ended with code {code}", "see its error above")
        return from_json(line, list[Flown])

    def end(self) -> None:
        """Close the worker's stdin, which ends it, and wait."""
        self._popen.communicate()


class WorkerPool:
    """Workers that each take the next job when they finish one."""

    def __init__(self, jobs: Iterable[Job], on_flown: Callable[[list[Flown]], None]) -> None:
        """Call `on_flown` with the results of each job, one job at a time."""
        self._jobs = iter(jobs)
        self._on_flown = on_flown
        self._lock = threading.Lock()
        self.problem: Exception | None = None

    def fly(self, workers: list[Worker]) -> None:
        """Fly all jobs; raise QuadctlError if a worker exits, and any error of a thread."""
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
                with self._lock:
                    self._on_flown(flown)
            except Exception as problem:  # noqa: BLE001 - raised by `fly`
                self.problem = problem
                return


def compiled() -> MakeFleet | None:
    """Return the maker of vehicles compiled by numba, None without numba."""
    try:
        module = load_kernel()
    except ImportError:
        return None

    def make(params: Sequence[DynamicsParams]) -> VehicleBatch:
        return Compiled(params, module)

    return make


def load_kernel() -> ModuleType:
    """Return the kernel, its functions compiled; raise ImportError without numba.

    Of several processes that need it, one compiles, and the others find its result in the cache.
    """
    module = source.load_module("kernel", kernel.kernel_source() + watch.compiled_source())
    with turn(source.cache_folder() / "kernel.lock"):
        pair = Conditions(1.0, vehicles=2)
        batch(Job(0, 1, pair), lambda params: Compiled(params, module)).fly()
        vehicle = Compiled([DynamicsParams()], module)
        vehicle.goto(0, 1.0, 0.0, 1.0)
        vehicle.brake(0)
        vehicle.room(0)
        Batch(
            missions(0, Conditions(1.0), Random), lambda params: Compiled(params, module)
        ).fly_near()
    return module


def batch(job: Job, make: MakeFleet, *, log: bool = False) -> Batch:
    """Return the flights of a job."""
    seeds = range(job.first, job.first + job.count)
    flown = [each for seed in seeds for each in missions(seed, job.conditions, Random)]
    return Batch(flown, make, vehicles=job.conditions.vehicles, log=log)


def main() -> None:
    """Fly each job from stdin."""
    jobs: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_read, args=(jobs.put,), daemon=True).start()
    make = compiled() or Plain
    # Numba's objects stay, and flights leave almost nothing that is not freed at once.
    gc.freeze()
    gc.disable()
    while True:
        job = from_json(jobs.get(), Job)
        emit(_flown(job, make))
        # The monitors of a batch refer to its flights, and these to them.
        gc.collect()


def _flown(job: Job, make: MakeFleet) -> list[Flown]:
    if not job.missions:
        return batch(job, make).fly() if job.count else []
    return Batch(job.missions, make).fly_near()


def _read(take: Callable[[bytes], None]) -> None:
    # Not by sys.stdin: its lock would turn any error of this process into a fatal one.
    with os.fdopen(0, "rb", closefd=False) as lines:
        for line in lines:
            take(line)
    os._exit(0)


if __name__ == "__main__":
    main()
