"""The room that a vehicle takes to come to rest, as a campaign's score asks for it.

World frame ENU, SI units. Straight-line text, as in rigidbody.py; where a choice saves work, it
is an `if` on its own.
"""

from services.dynamics import pilot, setpoint
from services.dynamics.controller import PERIOD
from services.dynamics.pilot import Mode
from services.dynamics.setpoint import Plan
from services.dynamics.sharing import Limits

LAGS = 6.0
"""Lags of the setpoint after which it is on its path's last stretch."""

EVERY = 4
"""Control periods between the points of a stop that are looked at."""

Point = tuple[float, float, float]


def periods_of(limits: Limits) -> int:
    """Control periods that a stop is looked at for."""
    return round(LAGS * limits[3] / PERIOD)


def widened(low: Point, high: Point, place: Point) -> tuple[Point, Point]:
    """The box that holds another point too, by its lowest and its highest corner."""
    x, y, z = place
    lx, ly, lz = low
    hx, hy, hz = high
    return (
        (x if x < lx else lx, y if y < ly else ly, z if z < lz else lz),
        (x if x > hx else hx, y if y > hy else hy, z if z > hz else hz),
    )


def room(plan: Plan, mode: Mode, limits: Limits, periods: int) -> tuple[Point, Point]:
    """The box, m, that the setpoint stays in up to its stopping point, were it to brake now.

    It lags behind its own path, which may have turned.
    """
    low = pilot.place(plan, limits)
    high = low
    if plan[6] < limits[7]:
        plan, _ = pilot.brake(plan, mode, limits)
        # Where it gets more of the limits on its way it stops nearer.
        low, high = widened(low, high, (plan[0][3], plan[1][3], plan[2][3]))
        for count in range(periods):
            plan = setpoint.advance(plan, limits)
            if count % EVERY == 0:
                low, high = widened(low, high, pilot.place(plan, limits))
    return low, high
