"""Workers of a campaign: no error of one is taken for the end of its flights."""

import sys
from collections.abc import Callable

import pytest

from quadctl.services.campaign import workers
from quadctl.services.campaign.mission import Conditions
from quadctl.services.campaign.score import Flown
from quadctl.services.campaign.workers import Job, Worker, WorkerPool
from quadctl.services.runtime.errors import QuadctlError

JOBS = [Job(seed, 1, Conditions(1.0)) for seed in range(3)]

Fly = Callable[[str, Callable[[list[Flown]], None]], None]


@pytest.fixture
def fly(monkeypatch: pytest.MonkeyPatch) -> Fly:
    """Function that flies the jobs on one worker, a program that has read the first of them."""

    def fly(program: str, on_flown: Callable[[list[Flown]], None]) -> None:
        program = f"import os; os.read(0, 1 << 16); {program}"
        monkeypatch.setattr(workers, "_COMMAND", (sys.executable, "-S", "-c", program))
        worker = Worker()
        try:
            WorkerPool(JOBS, on_flown).fly([worker])
        finally:
            worker.end()

    return fly


def test_a_worker_that_dies_in_the_middle_of_a_line_ends_the_campaign(fly: Fly):
    with pytest.raises(QuadctlError, match="a campaign worker ended with code 9"):
        fly("os.write(1, b'[{\"seed\": '); os._exit(9)", list[Flown]().extend)


def test_any_other_error_of_a_thread_ends_the_campaign(fly: Fly):
    def fail(_flown: object) -> None:
        raise ValueError("no room")

    with pytest.raises(ValueError, match="no room"):
        fly("os.write(1, b'[]\\n'); os.read(0, 1)", fail)
