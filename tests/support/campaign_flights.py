"""Batches of random flights in plain Python, and automata with an injected fault."""

import sqlite3
from collections.abc import Callable, Iterable
from contextlib import closing
from functools import partial
from pathlib import Path
from random import Random

import pytest

from quadctl.services.campaign.batch import Batch
from quadctl.services.campaign.mission import Conditions, Mission, mission
from quadctl.services.campaign.vehicles import Plain
from quadctl.services.campaign.watch import Floats
from quadctl.services.safety import automaton, monitor
from quadctl.services.safety.automaton import RULES, Rule


def missions(seeds: Iterable[int], seconds: float, *, faults: bool = False) -> list[Mission]:
    return [mission(seed, Random(seed), Conditions(seconds, faults)) for seed in seeds]


def batch(seeds: Iterable[int], seconds: float, *, faults: bool = False) -> Batch:
    return Batch(missions(seeds, seconds, faults=faults), Plain)


def kept(database: Path) -> int:
    """Return how many flights a campaign's database has; 0 while there is none."""
    if not database.exists():
        return 0
    with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True)) as opened:
        tables = opened.execute(
            "SELECT count(*) FROM sqlite_master WHERE name = 'flights'"
        ).fetchone()[0]
        return int(opened.execute("SELECT count(*) FROM flights").fetchone()[0]) if tables else 0


class Sleepless(Batch):
    """Batch in which every monitor receives every pose, as in a live flight."""

    def awake(self, period: int, motion: Floats) -> list[int]:
        super().awake(period, motion)  # notes the last pose in motion
        return list(range(len(self.lanes)))


def inject(patch: pytest.MonkeyPatch, change: Callable[[Rule], Rule | None]) -> None:
    """Make every monitor, live or in a campaign, use a changed rule table."""
    rules = tuple(new for rule in RULES if (new := change(rule)) is not None)
    patch.setattr(monitor, "step", partial(automaton.step, rules=rules))
