"""A cage or a zone that changes in a turn: no farther out than with a hold in that instant."""

from concurrent.futures import ProcessPoolExecutor

import pytest

from quadctl.schemas.messages import Position
from quadctl.schemas.params import CageParams
from tests.support.bodies import dynamics_of
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


SLOW = {"max_speed": 0.1, "max_acceleration": 0.2, "max_jerk": 1.7}
GENTLE = {"max_speed": 0.44, "max_acceleration": 1.0, "max_jerk": 8.6, "max_tilt": 0.125}
LOW = (
    Change(
        Position(2.02, -0.73, 0.055),
        (
            (Position(-3.23, -1.72, 0.19), 1.27),
            (Position(2.34, 1.37, 0.045), 1.166),
            (Position(-1.9, 1.36, 0.145), 0.119),
        ),
        CageParams(1.91, 1.86, 0.7),
        body=dynamics_of({f"dynamics.control.{name}": value for name, value in SLOW.items()}),
    ),
    Change(
        Position(-2.44, 1.24, 0.073),
        (
            (Position(4.61, 3.17, 0.022), 0.605),
            (Position(-3.06, -3.52, 3.389), 0.978),
            (Position(1.36, -1.32, 0.289), 0.401),
        ),
        CageParams(1.37, 1.33, 0.39),
        toggled=True,
        body=dynamics_of({f"dynamics.control.{name}": value for name, value in GENTLE.items()}),
    ),
)


@pytest.mark.parametrize("change", LOW, ids=["slow", "gentle"])
def test_a_flight_that_begins_in_motion_near_the_floor_stops_first_as_a_hold_does(change: Change):
    # A search found both: the vehicle went on to where its axes would stop with their present shares.
    assert farther(change) <= MOST


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
