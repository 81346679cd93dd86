"""Stops at any moment of flights with replaced goals, by the vehicle alone, beside the box of its law."""

from math import hypot
from random import Random

import numpy as np

from quadctl.schemas.params import DynamicsParams, StartParams
from quadctl.schemas.topics import SETPOINT
from quadctl.services.airspace.airworthiness import flown, stopping_law
from quadctl.services.airspace.stopping import StoppingLaw
from quadctl.services.campaign.vehicles import Compiled
from quadctl.services.campaign.watch import Floats
from tests.support.bodies import dynamics_of, random_body
from tests.support.compiled import compiled_kernel
from tests.support.evolved import Genes, evolve_together

_HEIGHT = 500.0
"""Height of the start (m): no stop comes near the floor."""
_RESTS = 0.005
"""Speed (m/s) of a stop that has ended."""
_TOGETHER, _STEPS = 250, 10


def box(law: StoppingLaw, pose: Floats) -> tuple[Floats, Floats]:
    """Return the least and greatest place (m) of a stop; `pose` has place and velocity."""
    speed = hypot(*pose[3:6])
    high = [p + law.reach(v, speed) for p, v in zip(pose[:3], pose[3:6], strict=True)]
    low = [p - law.reach(-v, speed) for p, v in zip(pose[:3], pose[3:6], strict=True)]
    return np.array(low), np.array(high)


def search(evaluations: int, island: int = 0) -> float:
    """Return the most (m) that a vehicle of the table goes beyond its box in so many stops."""
    return -evolve_together(
        lambda genes: [-out for out in _beyond(genes)],
        evaluations,
        island,
        together=min(_TOGETHER, evaluations),
    )


def _drawn(
    draws: Random,
) -> tuple[DynamicsParams, dict[int, tuple[float, float, float] | None], int]:
    """Return a vehicle, its goals by period, with None for the stop, and the period of the stop."""
    flies = dynamics_of(random_body(draws, soft=draws.random() < 0.5))
    flies.start = StartParams(0.0, 0.0, _HEIGHT)
    limits = flown(flies.vehicle, flies.control, flies.wind)
    scale = max(limits.max_speed**2 / limits.max_acceleration, 0.3)
    commands: dict[int, tuple[float, float, float] | None] = {}
    period = 1
    for _ in range(draws.randint(1, 5)):
        length = scale * 10 ** draws.uniform(-1.5, 0.7)
        x, y, z = (draws.gauss(0, length) for _ in range(3))
        commands[period] = x, y, _HEIGHT + z
        period += 1 + int(draws.random() * 2 * SETPOINT.hz)
    commands[period] = None
    return flies, commands, period


def _beyond(genes: list[Genes]) -> list[float]:
    drawn = [_drawn(draws) for draws in genes]
    laws = [stopping_law(p.vehicle, p.control, p.wind) for p, _, _ in drawn]
    fleet = Compiled([p for p, _, _ in drawn], compiled_kernel())
    count = len(drawn)
    low, high = np.full((3, count), -np.inf), np.full((3, count), np.inf)
    out, motion = np.full(count, -np.inf), fleet.fly(0, 1)[0]
    before, last, period = motion, max(stop for _, _, stop in drawn), 0
    while period < last + SETPOINT.hz or np.abs(motion[3:6]).max() > _RESTS:
        period += 1
        for number, (_, commands, _) in enumerate(drawn):
            if period not in commands:
                continue
            if goal := commands[period]:
                fleet.goto(number, *goal)
            else:
                fleet.brake(number)
                # The newest pose that safety may have is one period old.
                low[:, number], high[:, number] = box(laws[number], before[:, number])
        before = motion
        motions = fleet.fly(_STEPS, 50 // _STEPS)
        motion = motions[-1]
        places = motions[:, :3, :]
        out = np.maximum(out, np.maximum(places - high, low - places).max(axis=(0, 1)))
    return list(map(float, out))
