"""Score and digest of a campaign flight."""

import hashlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from msgspec.structs import replace

from quadctl.schemas.messages import PAUSED, CageSize, Position, SafetyState
from quadctl.services.campaign import watch
from quadctl.services.campaign.score import (
    FlightLog,
    Flown,
    LaunchCage,
    Score,
    Tally,
    farthest,
    inside,
)

HERE, CAGE = Position(1.0, 2.0, 1.0), CageSize(5.0, 5.0, 5.0)
FAR = "outside the cage: x = 9 is beyond [-5, 5]"


def state(reason: str, *, name: str = "HOVERING", request: int = 1, z: float = 1.0) -> SafetyState:
    where = Position(HERE.x, HERE.y, z)
    return SafetyState("campaign", 0.5, request, name, where, True, CAGE, reason)  # type: ignore[arg-type]


def digest(
    published: SafetyState,
    line: str = "",
    goal: tuple[float, float, float] = (9.0, 0.0, 1.0),
    why: str = FAR,
) -> str:
    log = FlightLog(log=False)
    log.requested(goal, why)
    log.published(published, line)
    return log.digest.hexdigest()


USUAL = digest(state(FAR), "Current State: HOVERING")


def test_the_wording_of_reasons_and_log_lines_does_not_count():
    assert digest(state("too far away"), "now hovering", why="too far away") == USUAL


@pytest.mark.parametrize(
    "other",
    [
        digest(state("")),
        digest(state(PAUSED + FAR)),
        digest(state(FAR, name="MOVING")),
        digest(state(FAR, request=2)),
        digest(state(FAR, z=1.0000000000000002)),
        digest(state(FAR), goal=(9.0, 0.0, 1.0000000000000002)),
        digest(state(FAR), why=""),
    ],
    ids=["no reason", "pause", "state", "request", "goal", "asked", "verdict"],
)
def test_verdicts_states_and_goals_count(other: str):
    assert other != USUAL


def test_a_state_that_differs_only_in_wording_is_not_counted():
    log = FlightLog(log=False)
    log.requested((9.0, 0.0, 1.0), FAR)
    for reason in (FAR, "farther", FAR):
        log.published(state(reason), reason)
    assert log.digest.hexdigest() == USUAL


def flown(seed: int, **fields: Any) -> Flown:
    one = {"x": 1}
    cage = LaunchCage(on=True, x=5.0, y=5.0, z=5.0)
    quiet = Flown(seed, cage, 0.0, 0.0, one, one, one, one, (0.0, 0.0), {}, [], [], f"h{seed}")
    return replace(quiet, **fields)


@given(st.permutations(range(7, 12)))
def test_a_tally_is_independent_of_the_order_of_flights(order: list[int]):
    tally = Tally(range(7, 12))
    for seed in order:
        bad = ["MOVING to a goal outside"] if seed % 2 else []
        tally.add(flown(seed, worst_excursion=0.1 * (seed > 8), violations=bad))
    document = tally.document(0)
    assert document["hash"] == hashlib.sha256(b"h7h8h9h10h11").hexdigest()
    assert (document["flights"], document["stops"]) == (5, {"x": 5})
    assert document["worst"]["seed"] == 9
    assert [each["seed"] for each in document["violations"]] == [7, 9, 11]


@given(st.lists(st.integers(1, 400), min_size=1, max_size=60))
def test_arrivals_have_the_quantiles_of_the_sorted_times(periods: list[int]):
    tally = Tally(range(1))
    tally.add(flown(0, arrivals=[count / 20 for count in periods]))
    ordered = sorted(periods)
    parts = {"median": 0.5, "p90": 0.9, "p99": 0.99, "most": 1.0}
    assert tally.document(0)["arrivals"] == {"count": len(periods)} | {
        name: ordered[round(part * (len(periods) - 1))] / 20 for name, part in parts.items()
    }


SIZE = (5.0, 4.0, 2.0)


def at(score: Score, *places: tuple[float, float, float], now: float = 0.0) -> list[float]:
    score.sample(np.array([places]).transpose(0, 2, 1), [now], watch)
    worst: list[float] = score.worst.tolist()
    return worst


@pytest.mark.parametrize("place", [(5.0, -4.0, 0.0), (-5.0, 4.0, 2.0), (0.0, 0.0, 1.0)])
def test_a_point_on_a_wall_is_inside(place: tuple[float, float, float]):
    assert inside(place, SIZE)


@pytest.mark.parametrize(
    "place", [(5.1, 0, 1), (0, -4.1, 1), (0, 0, -0.1), (0, 0, 2.1), (float("nan"), 0, 1)]
)
def test_a_point_beyond_a_wall_is_outside(place: tuple[float, float, float]):
    assert not inside(place, SIZE)


def test_excursions_count_once_the_cage_is_on():
    score = Score(2)
    assert at(score, (9, 0, 1), (9, 0, 1)) == [0.0, 0.0]
    score.confine(0, SIZE, 0.0)
    assert at(score, (5.0, 0, 1), (9, 0, 1), now=1.0) == [0.0, 0.0]
    assert at(score, (5.3, 4.4, 1), (9, 0, 1), now=2.0) == [pytest.approx(0.5), 0.0]
    assert at(score, (5.1, 0, 1), (9, 0, 1), now=3.0)[0] == pytest.approx(0.5)
    assert score.at.tolist() == [2.0, 0.0]


def test_the_first_time_of_the_worst_excursion_is_kept():
    score = Score(1)
    score.confine(0, SIZE, 0.0)
    way = [[(x, 0.0, 1.0)] for x in (5.1, 5.4, 5.2, 5.4)]
    score.sample(np.array(way).transpose(0, 2, 1), [1.0, 2.0, 3.0, 4.0], watch)
    assert (score.worst.tolist(), score.at.tolist()) == ([pytest.approx(0.4)], [2.0])


def test_a_vehicle_outside_may_brake_but_not_move_farther_out():
    score = Score(1)
    score.confine(0, SIZE, farthest([(6.0, 0.0, 1.0), (7.5, 0.0, 1.0)], SIZE))
    assert at(score, (7.5, 0, 1)) == [0.0]
    score.nearer(0, 1.0)
    score.nearer(0, 2.0)
    assert at(score, (6.2, 0, 1)) == [pytest.approx(0.2)]
    score.free(0)
    assert at(score, (20, 0, 1)) == [pytest.approx(0.2)]


def test_only_vehicles_outside_are_returning():
    score = Score(3)
    score.confine(1, SIZE, 0.5)
    score.confine(2, SIZE, 0.0)
    assert score.returning() == [1]


def test_the_farthest_excursion_is_taken_axis_by_axis():
    # The path may pass the corner of its bounding box.
    assert farthest([(5.3, 0.0, 1.0), (0.0, 4.4, 1.0)], SIZE) == pytest.approx(0.5)
    assert farthest([(0.0, 0.0, 1.0), (1.0, 1.0, 2.0)], SIZE) == 0.0
