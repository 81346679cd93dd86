"""A cage or a zone that changes in a turn: no farther out than with a hold in that instant."""

from concurrent.futures import ProcessPoolExecutor

import pytest

from quadctl.schemas.messages import Position
from quadctl.schemas.params import CageParams
from tests.support.changed_flights import Change, farther, search
from tests.support.proofs import Proofs

MOST = 0.01
"""Distance (m) that a flight may get farther out than its twin."""
SIDE, BACK, CORNER = Position(4.0, 5.0, 2.0), Position(-5.0, 4.0, 1.0), Position(-0.5, 0.3, 1.5)


@pytest.mark.parametrize("toggled", [False, True], ids=["shrunk", "turned on"])
@pytest.mark.parametrize("seconds", [0.3, 0.5, 0.9])
def test_a_cage_around_the_new_goal_of_a_turn_leads_no_farther_out_than_a_hold(
    seconds: float, toggled: bool
):
    goals = ((SIDE, 1.4), (BACK, seconds), (CORNER, 0.1))
    cage = CageParams(0.6, 0.4, 1.6)
    assert farther(Change(Position(-4.0, -5.0, 2.0), goals, cage, toggled=toggled)) <= MOST


def test_changes_in_random_flights_lead_no_farther_out_than_a_hold():
    assert search(30) <= MOST


@pytest.mark.prove
@pytest.mark.timeout(7200)
def test_100_000_changes_lead_no_farther_out_than_a_hold(proofs: Proofs):
    with ProcessPoolExecutor() as pool:
        worst = max(pool.map(search, [12_500] * 8, range(8)))
    proofs.add(
        "100 000 changes of cage or zones in flight", f"{1000 * worst:.2g} mm farther", "10 mm"
    )
    assert worst <= MOST
