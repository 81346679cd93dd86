"""Track of a flight that is flown again."""

import numpy as np
import pytest

from quadctl.schemas.params import CageParams, DynamicsParams, SafetyParams, StartParams
from quadctl.services.campaign.batch import Batch
from quadctl.services.campaign.mission import CageEvent, GotoEvent, Mission, Resize
from quadctl.services.campaign.track import retrace
from quadctl.services.campaign.vehicles import Plain

SAFETY = SafetyParams(
    cage_on=True, takeoff=0.0, virtual_cage=CageParams(5.0, 4.0, 3.0), margin=0.25
)
ROWS = (
    GotoEvent(0.1, 1.0, 0.0, 1.0, replace=False),
    CageEvent(1.0, on=False),
    Resize(2.0, 2.0, 2.0, 2.0),
    CageEvent(3.0, on=True),
)


def test_a_track_has_the_path_and_the_cage_at_each_time():
    mission = Mission(0, 4.0, SAFETY, DynamicsParams(start=StartParams(z=1.0)), ROWS)
    track = retrace(Batch([mission], Plain))
    assert track.margin == 0.25
    assert track.times[[0, -1]].tolist() == [0.0, 4.0]
    assert track.positions[0].tolist() == [0.0, 0.0, 1.0]
    assert track.positions[-1] == pytest.approx([1.0, 0.0, 1.0], abs=0.01)
    at = {
        time: track.cages[np.searchsorted(track.times, time)].tolist() for time in (0.95, 3.0, 4.0)
    }
    assert at == {0.95: [5.0, 4.0, 3.0], 3.0: [2.0, 2.0, 2.0], 4.0: [2.0, 2.0, 2.0]}
    off = np.isnan(track.cages).all(axis=1)
    assert track.times[off][[0, -1]].tolist() == [1.0, 2.95]
