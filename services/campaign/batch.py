"""A batch of flights, period by period: the vehicles fly, their monitors watch, the score is kept."""

from collections.abc import Callable, Sequence
from math import sqrt

import numpy as np

from schemas.params import DynamicsParams, MeanWindParams, StartParams, WindParams
from schemas.topics import SETPOINT
from services.campaign.diary import Flown
from services.campaign.fleets import Fleet
from services.campaign.lane import Lane
from services.campaign.oracle import Floats, Score, farthest
from services.campaign.rows import Mission
from services.campaign.watch import Watch
from services.dynamics.heed import Heed

_STEPS = round(1000 / SETPOINT.hz)
"""Of 1 ms, in a period."""
_SAMPLES = 5
"""How often in a period it is looked how far beyond the cage a vehicle is."""
_RATCHET = 10
"""Periods after which it is looked how much nearer a vehicle outside has come."""
_SLOW = 0.3
"""Speed on an axis, m/s."""

GUST = 0.25
"""RMS of the gusts on each axis, in mean winds."""

MakeFleet = Callable[[Sequence[DynamicsParams]], Fleet]


class Batch:
    """Flights of one length, each for itself."""

    def __init__(self, missions: Sequence[Mission], make: MakeFleet, *, log: bool = False) -> None:
        """Each vehicle at rest on its start; with `log` the diaries keep their lines."""
        self.missions = missions
        params = [_params(mission) for mission in missions]
        self._silence, self._grace = DynamicsParams().setpoint_timeout, DynamicsParams().grace
        self._fleet = make(params)
        self.lanes = [Lane(mission, log=log) for mission in missions]
        count = len(missions)
        self._score, self._watch = Score(count), Watch(count)
        self._told: list[object] = [None] * count
        self._heeds = [Heed() for _ in missions]
        self._unscored = [True] * count
        self._periods = round(missions[0].seconds * SETPOINT.hz)
        self._track = np.empty((self._periods + 1, 6, count))

    def fly(self) -> list[Flown]:
        """Fly them to their end."""
        motion = self._fleet.motion()
        for period in range(self._periods + 1):
            self._track[period] = motion
            for number in self.awake(period, motion):
                self._step(number, period, motion)
            if period % _RATCHET == 0:
                # In full flight its stop is far away; it is looked at where it comes to rest.
                slow = np.abs(motion[3:]).max(axis=0) < _SLOW
                for number in self._score.returning():
                    if slow[number]:
                        self._score.nearer(number, self._farthest(number, motion))
            if period < self._periods:
                motion = self._advance(period)
        return [self._flown(number) for number in range(len(self.lanes))]

    def awake(self, period: int, motion: Floats) -> list[int]:
        """The flights whose monitors have something to do."""
        return self._watch.awake(period, motion, self._track[max(period - 1, 0)])

    def _advance(self, period: int) -> Floats:
        """Fly one period, keep the score, and say how they move then."""
        motions = []
        for _ in range(_SAMPLES):
            self._fleet.advance(_STEPS // _SAMPLES)
            motions.append(self._fleet.motion())
        times = [(period + sample / _SAMPLES) / SETPOINT.hz for sample in range(1, _SAMPLES + 1)]
        self._score.sample(np.array([motion[:3] for motion in motions]), times)
        return motions[-1]

    def _step(self, number: int, period: int, motion: Floats) -> None:
        lane = self.lanes[number]
        if lane.seen < period - 1:
            # Nothing came of it, but the next pose is looked at beside it.
            lane.see(period - 1, self._track[period - 1, :, number].tolist())
        here = motion[:, number].tolist()
        lane.see(period, here)
        if lane.act(period, here):
            # What a vehicle does about it that hears nothing is counted from when it hears again.
            self._unscored[number] = True
            self._score.free(number)
        self._tell(number, lane)
        if self._unscored[number] and self._told[number] is not None:
            self._unscored[number] = False
            if lane.cage_on:
                self._score.confine(number, lane.size, self._farthest(number, motion))
        self._watch.note(number, lane)

    def _tell(self, number: int, lane: Lane) -> None:
        """The setpoint reaches the vehicle, or it brakes where none does for too long."""
        setpoint, now = lane.setpoint(), lane.diary.now
        if now < lane.mute_until:
            if now - lane.last_told > self._silence:
                self._fleet.brake(number)
                self._heeds[number].stopped()
            self._told[number] = None
            return
        if self._told[number] is None and now - lane.last_told <= self._grace + self._silence:
            self._heeds[number].resumed()
        told = (setpoint.brake, setpoint.position)
        if told == self._told[number]:
            return
        self._told[number] = told
        place = setpoint.position
        heeds = self._heeds[number].heeds(place, brake=setpoint.brake)
        if setpoint.brake:
            self._fleet.brake(number)
        elif heeds:
            self._fleet.goto(number, place.x, place.y, place.z)

    def _farthest(self, number: int, motion: Floats) -> float:
        """How far beyond its cage (m) one vehicle gets that brakes now."""
        here = motion[:3, number].tolist()
        return farthest([here, *self._fleet.room(number)], self.lanes[number].size)

    def _flown(self, number: int) -> Flown:
        diary, mission = self.lanes[number].diary, self.missions[number]
        worst, at = self._score.worst[number].item(), self._score.at[number].item()
        margin = mission.safety.margin
        if worst > margin:
            diary.now = at
            diary.violated(f"more than {margin:g} m beyond the cage")
        diary.digest.update(repr(worst).encode())
        diary.digest.update(np.ascontiguousarray(self._track[:, :, number]).data)
        return Flown(
            mission.seed, worst, at, diary.transitions, diary.refusals, diary.stops,
            diary.arrivals, diary.violations, diary.digest.hexdigest(),
        )  # fmt: skip


def _params(mission: Mission) -> DynamicsParams:
    east, north = mission.wind
    gust = GUST * sqrt(east * east + north * north)
    wind = WindParams(mean=MeanWindParams(east, north), gust=gust)
    # The gusts of neighbouring flights have nothing in common all the same.
    return DynamicsParams(start=StartParams(*mission.start), wind=wind, seed=mission.seed % 2**31)
