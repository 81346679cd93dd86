"""Put outside by the cage that comes on, on every side and at every distance, and back inside."""

from itertools import pairwise, product

import numpy as np
import pytest

from quadctl.schemas.params import CageParams, SafetyParams
from quadctl.services.campaign.batch import Batch
from quadctl.services.campaign.mission import CageEvent, GotoEvent, Mission
from quadctl.services.campaign.vehicles import Plain

HALF, TOP = 2.0, 1.5
MIDDLE = (0.0, 0.0, 0.75)
# The sixth side is the floor, which nothing gets below.
SIDES = ((HALF, 0, 0), (-HALF, 0, 0), (0, HALF, 0), (0, -HALF, 0), (0, 0, TOP / 2))
DISTANCES = (0.3, 2.0, 6.0)
ON, BACK, END = 5.0, 5.5, 11.0


def mission(side: tuple[float, float, float], distance: float) -> Mission:
    length = sum(map(abs, side))
    x, y, z = (m + s * (1 + distance / length) for m, s in zip(MIDDLE, side, strict=True))
    safety = SafetyParams(cage_on=False, takeoff=0.0, virtual_cage=CageParams(HALF, HALF, TOP))
    rows = (
        GotoEvent(0.0, x, y, z, replace=False),
        CageEvent(ON, on=True),
        GotoEvent(ON, x, y, z, replace=False),
        GotoEvent(BACK, 0.5, -0.5, 0.5, replace=False),
    )
    return Mission(0, END, safety, MIDDLE, (0.0, 0.0), rows)


def test_it_hovers_in_place_takes_only_goals_inside_and_comes_nearer_at_every_step():
    places = list(product(SIDES, DISTANCES))
    batch = Batch([mission(side, distance) for side, distance in places], Plain)
    flown = batch.fly()
    size = np.array([HALF, HALF, TOP])
    for number, ((_, distance), flight) in enumerate(zip(places, flown, strict=True)):
        assert flight.violations == []
        assert flight.refusals == {"outside the cage": 1}
        assert flight.worst < 0.001
        way = batch._track[:, :3, number]
        outs = np.maximum(np.maximum(way - size, -size * (1, 1, 0) - way), 0.0)
        beyond = np.sqrt((outs * outs).sum(axis=1))
        on, back = round(20 * ON), round(20 * BACK)
        assert beyond[on] == pytest.approx(distance, abs=0.01)
        assert np.ptp(beyond[on:back]) < 0.005
        assert all(now <= before + 1e-6 for before, now in pairwise(beyond[back:]))
        assert beyond[-1] == 0.0
