"""What the log says of one state after another."""

import pytest

from quadctl.cli.console.model import point, told
from quadctl.schemas.messages import CageSize, Position
from tests.console.heard import state

GOAL = Position(1, 2, 1)
OUTSIDE = "outside the cage: x = 9 is beyond [-5, 5]"


@pytest.mark.parametrize(
    ("before", "now", "said"),
    [
        (None, state(reason=OUTSIDE), []),
        (state(), state(stamp=2.0), []),
        (state(), state(request=2, state="VERIFYING"), []),
        (state(request=2, state="VERIFYING"), state(request=2, state="MOVING", goal=GOAL),
         [("accepted", "to (1, 2, 1)")]),
        (state(request=2, state="VERIFYING"), state(request=2, reason=OUTSIDE),
         [("refused", OUTSIDE)]),
        (state(), state(request=2, reason=OUTSIDE), [("refused", OUTSIDE)]),
        (state(request=2, reason=OUTSIDE), state(request=3, reason=OUTSIDE),
         [("refused", OUTSIDE)]),
        (state(state="MOVING"), state(state="MOVING", request=2, reason="busy"),
         [("refused", "busy")]),
        (state(state="MOVING", goal=GOAL), state(goal=GOAL), [("arrived", "at (1, 2, 1)")]),
        (state(state="MOVING"), state(reason="hold: stopped on request"),
         [("stopped", "hold: stopped on request")]),
        (state(), state(cage_on=False), [("cage", "cage off")]),
        (state(state="MOVING", cage_on=False), state(reason="stopped, the goal"),
         [("cage", "cage on"), ("stopped", "stopped, the goal")]),
        (state(), state(cage=CageSize(3, 5, 2)),
         [("cage", "cage is now x [-3, 3], y [-5, 5], z [0, 2]")]),
        (state(state="MOVING"), state(boot="b", reason="a new boot"), [("boot", "a new boot")]),
    ],
)  # fmt: skip
def test_every_change_is_told_once(before, now, said):
    assert list(told(before, now)) == said


def test_a_negative_nought_has_no_minus():
    assert point(Position(-0.0, -0.001, 1.234)) == "(0, 0, 1.23)"
