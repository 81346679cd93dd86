"""Loops over all vehicles of a batch: poses that their monitors must see, and their excursions.

A pose moves the automaton only if a condition of its rules for `Seen` may hold. `look` tests these
with slack in favour of calling the monitor, which decides; the tests fly with and without it, to
the same states. Only arithmetic on floats and arrays: with numba it is compiled.
"""

import inspect
from math import sqrt

import numpy as np
import numpy.typing as npt

from quadctl.schemas.topics import SETPOINT
from quadctl.services.airspace import stopping
from quadctl.services.airspace.stopping import AT_REST, PATIENCE, outside, soonest

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

SLACK = 1e-9
PATIENT = PATIENCE * SETPOINT.hz
"""Periods at a standstill on its way after which a vehicle may be at fault."""

ROWS = (
    "WANTED", "SEEN", "MOVING", "SETTLING", "DUE", "MOVED", "REACH", "BRAKING", "REACTS", "FASTEST",
    "BEYOND", "MARGIN", "GOAL", "GOAL_Y", "GOAL_Z", "SIZE", "SIZE_Y", "SIZE_Z",
)  # fmt: skip
"""Notes on each monitor, one in a row.

Periods: in which it is wanted, in which it saw the last pose, in which its present standstill is at
fault, and of the last pose in motion. Flags: moving, settling. Its acceptance range (m), highest
deceleration (m/s^2), reaction (s) and way in a period (m); how far outside (m) it may stop, and the
margin (m); the goal and the cage's bounds, m.
"""
(
    WANTED, SEEN, MOVING, SETTLING, DUE, MOVED, REACH, BRAKING, REACTS, FASTEST,
    BEYOND, MARGIN, GOAL, GOAL_Y, GOAL_Z, SIZE, SIZE_Y, SIZE_Z,
) = range(len(ROWS))  # fmt: skip


def awaits(notes: Floats, n: int, motion: Floats, last: Floats, period: int) -> bool:
    """Return whether one monitor must see the pose of this period."""
    x, y, z = motion[0, n], motion[1, n], motion[2, n]
    vx, vy, vz = motion[3, n], motion[4, n], motion[5, n]
    speed = sqrt(vx * vx + vy * vy + vz * vz)
    moved = notes[MOVED, n]
    if speed >= AT_REST:
        notes[MOVED, n] = period
    if notes[WANTED, n] <= period:
        return True
    is_moving = notes[MOVING, n] > 0.0
    if is_moving:
        dx, dy, dz = x - notes[GOAL, n], y - notes[GOAL_Y, n], z - notes[GOAL_Z, n]
        if sqrt(dx * dx + dy * dy + dz * dz) < notes[REACH, n]:
            return True
        seen = notes[SEEN, n]
        if speed < AT_REST and (
            (moved <= seen and period >= notes[DUE, n]) or period - max(moved, seen) >= PATIENT
        ):
            return True
    if speed < AT_REST + SLACK and (notes[SETTLING, n] > 0.0 or speed > AT_REST - SLACK):
        return True
    d, t = notes[BRAKING, n], notes[REACTS, n]
    stop = outside(
        soonest(x, vx, d, t), soonest(y, vy, d, t), soonest(z, vz, d, t),
        notes[SIZE, n], notes[SIZE_Y, n], notes[SIZE_Z, n],
    )  # fmt: skip
    if stop > notes[BEYOND, n] + notes[MARGIN, n]:
        return True
    dx, dy, dz = x - last[0, n], y - last[1, n], z - last[2, n]
    leaps: bool = sqrt(dx * dx + dy * dy + dz * dz) >= notes[FASTEST, n]
    return leaps


def look(notes: Floats, motion: Floats, last: Floats, period: int, found: Ints) -> int:
    """Write the monitors that must see the pose of this period to `found`; return how many.

    `motion` and `last` are this pose and the one before: (6, vehicles).
    """
    count = 0
    for n in range(notes.shape[1]):
        if awaits(notes, n, motion, last, period):
            found[count] = n
            count += 1
    return count


def score(
    motions: Floats, times: Floats, size: Floats, allowed: Floats, worst: Floats, at: Floats
) -> None:
    """Record the worst excursion (m) of each vehicle, and its time, from (samples, 6, vehicles)."""
    for sample in range(motions.shape[0]):
        for n in range(motions.shape[2]):
            x, y, z = motions[sample, 0, n], motions[sample, 1, n], motions[sample, 2, n]
            excursion = outside(x, y, z, size[0, n], size[1, n], size[2, n]) - allowed[n]
            if excursion > worst[n]:
                worst[n] = excursion
                at[n] = times[sample]


def approach(motions: Floats, size: Floats, allowed: Floats, nearest: Floats) -> None:
    """Record how near to a wall each vehicle comes, m: negative inside; the floor does not count."""
    for sample in range(motions.shape[0]):
        for n in range(motions.shape[2]):
            x, y, z = motions[sample, 0, n], motions[sample, 1, n], motions[sample, 2, n]
            near = max(abs(x) - size[0, n], abs(y) - size[1, n], z - size[2, n]) - allowed[n]
            nearest[n] = max(nearest[n], near)


def separate(motions: Floats, times: Floats, vehicles: int, least: Floats, at: Floats) -> None:
    """Record the least distance (m) between two vehicles of each flight, and its time, s.

    The vehicles of a flight are neighbours in `motions`, (samples, 6, vehicles).
    """
    for sample in range(motions.shape[0]):
        for flight in range(least.shape[0]):
            for one in range(flight * vehicles, (flight + 1) * vehicles):
                for other in range(flight * vehicles, one):
                    dx = motions[sample, 0, one] - motions[sample, 0, other]
                    dy = motions[sample, 1, one] - motions[sample, 1, other]
                    dz = motions[sample, 2, one] - motions[sample, 2, other]
                    distance = sqrt(dx * dx + dy * dy + dz * dz)
                    if distance < least[flight]:
                        least[flight] = distance
                        at[flight] = times[sample]


def compiled_source() -> str:
    """Return the source of the loops for numba, to go after a kernel's source."""
    known = vars(stopping) | globals()
    names = ("AT_REST", "SLACK", "PATIENT", *ROWS)
    lines = ["", "Floats = Ints = None", *(f"{name} = {known[name]!r}" for name in names)]
    # Each after those that it calls.
    for function in (*stopping.SCALAR, awaits, look, score, approach, separate):
        cached = ", nogil=True, cache=True" if function in {look, score, approach, separate} else ""
        lines += [f"@njit(error_model='numpy'{cached})", inspect.getsource(function)]
    return "\n".join(lines)
