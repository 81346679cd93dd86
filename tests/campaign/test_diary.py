"""The diary of a flight: its hash covers states, goals and verdicts, never the wording of a reason."""

import pytest

from quadctl.schemas.messages import PAUSED, CageSize, Position, SafetyState
from quadctl.services.campaign.score import FlightLog

HERE, CAGE = Position(1.0, 2.0, 1.0), CageSize(5.0, 5.0, 5.0)
FAR = "outside the cage: x = 9 is beyond [-5, 5]"


def state(reason: str, *, name: str = "HOVERING", request: int = 1, z: float = 1.0) -> SafetyState:
    where = Position(HERE.x, HERE.y, z)
    return SafetyState("campaign", 0.5, request, name, where, True, CAGE, reason)  # type: ignore[arg-type]


def digest(
    told: SafetyState,
    line: str = "",
    goal: tuple[float, float, float] = (9.0, 0.0, 1.0),
    why: str = FAR,
) -> str:
    diary = FlightLog(log=False)
    diary.asked(goal, why)
    diary.told(told, line)
    return diary.digest.hexdigest()


USUAL = digest(state(FAR), "Current State: HOVERING")


def test_the_wording_of_reasons_and_lines_does_not_count():
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


def test_a_state_that_differs_in_wording_alone_is_none():
    diary = FlightLog(log=False)
    diary.asked((9.0, 0.0, 1.0), FAR)
    for reason in (FAR, "farther", FAR):
        diary.told(state(reason), reason)
    assert diary.digest.hexdigest() == USUAL
