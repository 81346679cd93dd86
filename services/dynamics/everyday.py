"""A control period without branches, but for what is rare: for arrays, which take vehicles by the thousand.

As in glide.py, what is rare is only told from the rest and left to `pilot.lead_on`; the rest is done
as there, to the bit. Straight-line text, as in rigidbody.py; SI units.
"""

from services.dynamics import wind
from services.dynamics.glide import PLAIN, RARE, glide
from services.dynamics.pilot import Constants, Mode, act, choose, ends_leg, lead_on, rest
from services.dynamics.rigidbody import Motors, State
from services.dynamics.setpoint import Plan, setpoint_of
from services.dynamics.sharing import Limits
from services.dynamics.wind import Air


def period(
    state: State, plan: Plan, mode: Mode, air: Air, constants: Constants
) -> tuple[Motors, Plan, Mode, Air, float]:
    """Motors' command, plan, mode and air, and 1 where plan and mode still are to be led on, else 0.

    For vehicles that are not at rest.
    """
    _, gains, mixer, limits, weight, _, weather = constants
    if weather[4] > 0.0:
        air = wind.blow(air, weather)
    mode, kind = choose(state, plan, mode, limits)
    command = act(state, setpoint_of(plan, limits), kind, weight, gains, mixer)
    after, due = glide(plan, limits)
    before = plan
    flies = kind == 2.0
    if flies & (due == PLAIN):
        plan = after
    waits = flies & ((due == RARE) | ((mode[4] > 0.0) & ends_leg(plan, limits)))
    rested = rest(state, command, plan, mode, limits)
    if waits:
        plan = before
        rested = mode
    return command, plan, rested, air, 1.0 if waits else 0.0


def remainder(
    state: State, command: Motors, plan: Plan, mode: Mode, limits: Limits
) -> tuple[Plan, Mode]:
    """Plan and mode at the end of a period, where `period` left them."""
    plan, mode = lead_on(plan, mode, 2.0, limits)
    return plan, rest(state, command, plan, mode, limits)
