"""The way to a goal: straight there through the air, and over the floor by a hop.

A straight way along the floor would scrape it, and touching it takes away all speed: from the
floor, or from just above it, to a place as low, the vehicle goes up, over and down instead.

World frame ENU, SI units.
"""

from math import dist, hypot

from services.dynamics.trajectory import Vector

HOP = 0.1
"""Height of a hop, m: less than any cage is high."""

NEAR = 0.01
"""A place this near (m) needs no hop: the vehicle is there."""

CLOSE = 0.05
"""A leg is left for the next one this far (m) before its end."""


def route(here: Vector, goal: Vector) -> list[Vector]:
    """Where to go one after another, m; the goal last."""
    low = here[2] < HOP and goal[2] < HOP
    if low and hypot(goal[0] - here[0], goal[1] - here[1]) > NEAR:
        return [(here[0], here[1], HOP), (goal[0], goal[1], HOP), goal]
    return [goal]


def leaves(here: Vector, legs: list[Vector]) -> bool:
    """Whether it is time for the leg after the first."""
    return len(legs) > 1 and dist(here, legs[0]) < CLOSE
