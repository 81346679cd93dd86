"""A worker: `python -P -m services.campaign.process.worker` flies the jobs that stdin brings.

It ends at once where stdin does, in the middle of a batch too: whoever gave it the job is gone.
"""

import gc
import os
import sys
import threading
from collections.abc import Callable, Sequence
from queue import SimpleQueue
from random import Random

import msgspec

from schemas.params import DynamicsParams
from services.campaign.batch import Batch, MakeFleet
from services.campaign.fleets import Compiled, Fleet, Plain
from services.campaign.mission import mission
from services.campaign.process.orders import Done, Job, say
from services.dynamics.fleet import kernel
from services.runtime import generated

_GARBAGE = 50_000
"""Objects after which it is looked for garbage."""


def compiled() -> MakeFleet | None:
    """How to make vehicles compiled by numba; None where there is none."""
    try:
        module = generated.load("kernel", kernel.source())
    except ImportError:
        return None

    def make(params: Sequence[DynamicsParams]) -> Fleet:
        return Compiled(params, module)

    return make


def batch(job: Job, make: MakeFleet, *, log: bool = False) -> Batch:
    """The flights of a job."""
    seeds = range(job.first, job.first + job.count)
    missions = [
        mission(seed, Random(seed), job.seconds, wind=job.wind, faults=job.faults) for seed in seeds
    ]
    return Batch(missions, make, log=log)


def main() -> None:
    """Fly what is asked for, line by line."""
    jobs: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_read, args=(jobs.put,), daemon=True).start()
    make = compiled() or Plain
    _warm(make([DynamicsParams()]))
    # What numba has loaded stays, and flights leave next to nothing that is not freed at once.
    gc.freeze()
    gc.set_threshold(_GARBAGE)
    while True:
        job = msgspec.json.decode(jobs.get(), type=Job)
        say(Done(batch(job, make).fly() if job.count else []))


def _warm(fleet: Fleet) -> None:
    """Where it must be compiled first, now."""
    fleet.goto(0, 1.0, 0.0, 1.0)
    fleet.advance(1)
    fleet.room(0)
    fleet.brake(0)


def _read(take: Callable[[bytes], None]) -> None:
    for line in sys.stdin.buffer:
        take(line)
    os._exit(0)


if __name__ == "__main__":
    main()
