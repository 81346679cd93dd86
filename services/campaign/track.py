"""Track of a flight that is flown again, for its picture."""

from typing import NamedTuple

import numpy as np

from quadctl.schemas.topics import SETPOINT
from quadctl.services.campaign.batch import Batch
from quadctl.services.campaign.mission import CageEvent, Mission, Resize
from quadctl.services.campaign.watch import Floats


class FlightTrack(NamedTuple):
    """Flight in order of time, and its margin beyond the cage, m."""

    times: Floats
    """s, (n,)"""
    positions: Floats
    """m, (n, 3)"""
    cages: Floats
    """The cage's size at each time, m, (n, 3); NaN while it is off."""
    margin: float


def retrace(batch: Batch) -> FlightTrack:
    """Fly a batch to its end, and return the track of its first flight's worst vehicle."""
    batch.fly()
    worst = batch.worst(0)
    mission, positions = batch.missions[worst], batch.path(worst)
    times = np.arange(len(positions)) / SETPOINT.hz
    return FlightTrack(times, positions, _cages(mission, times), mission.margin)


def _cages(mission: Mission, times: Floats) -> Floats:
    size, on = mission.safety.virtual_cage, mission.safety.cage_on
    now, found = (size.x, size.y, size.z), np.empty((len(times), 3))
    found[:] = now if on else np.nan
    for row in mission.rows:
        match row:
            case CageEvent():
                on = row.on
            case Resize(_, x, y, z):
                now = x, y, z
        found[times >= row.at] = now if on else np.nan
    return found
