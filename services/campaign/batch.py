"""Batch of flights, flown period by period, and a filter that skips idle monitors.

A pose moves the automaton only if a condition of its rules for `Seen` may hold. The filter tests
these for all vehicles at once, with slack in favour of calling the monitor, which decides. The
tests fly with and without the filter, to the same states.
"""

from collections.abc import Callable, Sequence
from math import inf, sqrt

import numpy as np
import numpy.typing as npt

from quadctl.schemas.params import DynamicsParams, MeanWindParams, StartParams, WindParams
from quadctl.schemas.topics import SETPOINT
from quadctl.services.campaign.flight import SimulatedFlight
from quadctl.services.campaign.mission import Mission
from quadctl.services.campaign.score import Floats, Flown, Score, farthest
from quadctl.services.campaign.vehicles import VehicleBatch
from quadctl.services.dynamics.simulation import GoalLatch
from quadctl.services.safety.cage import AT_REST
from quadctl.services.safety.model import State

_SLACK = 1e-9
_NOTES = 17
"""Rows of notes on each monitor: the period in which it is due; flags for moving, at a standstill,
settling and returning; its acceptance range; half over its deceleration (s^2/m); its way in a
period (m); and the three vectors below."""
_GOAL, _LOW, _HIGH = slice(8, 11), slice(11, 14), slice(14, 17)


class MonitorFilter:
    """Conditions that the monitors of a batch wait for."""

    def __init__(self, count: int) -> None:
        """Make all due in the first period."""
        self._notes = np.zeros((_NOTES, count))
        self._notes[_LOW], self._notes[_HIGH] = -np.inf, np.inf

    def note(self, number: int, lane: SimulatedFlight) -> None:
        """Note the conditions that one monitor waits for from now on."""
        s, params = lane.monitor.situation, lane.params
        goal, size, out = s.goal, params.virtual_cage, 0.0 if s.cage_on and s.beyond < inf else inf
        # One assignment: writing them one by one would take ten times as long.
        self._notes[:, number] = (
            lane.wanted, s.state is State.MOVING, lane.is_standing, s.settling,
            s.cage_on and 0.0 < s.beyond < inf,
            params.acceptance_range + _SLACK, 0.5 / params.max_deceleration,
            params.max_speed / SETPOINT.hz,
            goal.x, goal.y, goal.z,
            _SLACK - size.x - out, _SLACK - size.y - out, _SLACK - out,
            size.x - _SLACK + out, size.y - _SLACK + out, size.z - _SLACK + out,
        )  # fmt: skip

    def awake(self, period: int, motion: Floats, last: Floats) -> list[int]:
        """Return the monitors that must see this pose, of (6, vehicles)."""
        place, velocity = motion[:3], motion[3:]
        wanted, moving, standing, settling, returning, reach, half, fastest = self._notes[:8]
        arrives = _within(place - self._notes[_GOAL], reach)
        rests = ((settling > 0.0) | (moving > standing)) & _within(velocity, AT_REST + _SLACK)
        starts = (standing > 0.0) & ~_within(velocity, AT_REST - _SLACK)
        stop = place + half * velocity * np.abs(velocity)
        leaves = ((stop > self._notes[_HIGH]) | (stop < self._notes[_LOW])).any(axis=0)
        leaps = ~_within(place - last[:3], fastest)
        arrives &= moving > 0.0
        found = (wanted <= period) | (returning > 0.0) | arrives | leaves | rests | starts | leaps
        numbers: list[int] = np.flatnonzero(found).tolist()
        return numbers


def _within(vectors: Floats, length: Floats | float) -> npt.NDArray[np.bool_]:
    squares = vectors * vectors
    within: npt.NDArray[np.bool_] = squares[0] + squares[1] + squares[2] < length * length
    return within


_STEPS = round(1000 / SETPOINT.hz)
"""Steps of 1 ms in a period."""
_SAMPLES = 5
"""Samples of the excursion in a period."""
_RATCHET = 10
"""Periods between checks of how much nearer a vehicle outside has come."""
_SLOW = 0.3
"""Speed (m/s) on an axis below which a vehicle outside is checked."""

GUST = 0.25
"""Ratio of the gusts' RMS on each axis to the mean wind."""

MakeFleet = Callable[[Sequence[DynamicsParams]], VehicleBatch]


class Batch:
    """Independent flights of one length."""

    def __init__(self, missions: Sequence[Mission], make: MakeFleet, *, log: bool = False) -> None:
        """Put each vehicle at rest on its start; keep log lines only with `log`."""
        self.missions = missions
        params = [_params(mission) for mission in missions]
        self._silence, self._grace = DynamicsParams().setpoint_timeout, DynamicsParams().grace
        self._fleet = make(params)
        self.lanes = [SimulatedFlight(mission, log=log) for mission in missions]
        count = len(missions)
        self._score, self._watch = Score(count), MonitorFilter(count)
        self._sent: list[object] = [None] * count
        self._latches = [GoalLatch() for _ in missions]
        self._unscored = [True] * count
        self._periods = round(missions[0].seconds * SETPOINT.hz)
        self._track = np.empty((self._periods + 1, 6, count))

    def fly(self) -> list[Flown]:
        """Fly all to their end."""
        motion = self._fleet.motion()
        for period in range(self._periods + 1):
            self._track[period] = motion
            for number in self.awake(period, motion):
                self._step(number, period, motion)
            if period % _RATCHET == 0:
                # In full flight its stop is far away, so it is checked when slow.
                slow = np.abs(motion[3:]).max(axis=0) < _SLOW
                for number in self._score.returning():
                    if slow[number]:
                        self._score.nearer(number, self._farthest(number, motion))
            if period < self._periods:
                motion = self._advance(period)
        return [self._flown(number) for number in range(len(self.lanes))]

    def awake(self, period: int, motion: Floats) -> list[int]:
        """Return the flights with a monitor that must run."""
        return self._watch.awake(period, motion, self._track[max(period - 1, 0)])

    def _advance(self, period: int) -> Floats:
        """Fly one period, keep the score, and return the motions at its end."""
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
            # The previous pose changed nothing, but the next one is compared with it.
            lane.see(period - 1, self._track[period - 1, :, number].tolist())
        here = motion[:, number].tolist()
        lane.see(period, here)
        if lane.act(period, here):
            # While no setpoint reaches a vehicle, its excursion does not count.
            self._unscored[number] = True
            self._score.free(number)
        self._send_setpoint(number, lane)
        if self._unscored[number] and self._sent[number] is not None:
            self._unscored[number] = False
            if lane.cage_on:
                self._score.confine(number, lane.size, self._farthest(number, motion))
        self._watch.note(number, lane)

    def _send_setpoint(self, number: int, lane: SimulatedFlight) -> None:
        """Send the setpoint to the vehicle, or brake it after too long without one."""
        setpoint, now = lane.setpoint(), lane.diary.now
        if now < lane.mute_until:
            if now - lane.last_sent > self._silence:
                self._fleet.brake(number)
                self._latches[number].stopped()
            self._sent[number] = None
            return
        if self._sent[number] is None and now - lane.last_sent <= self._grace + self._silence:
            self._latches[number].resumed()
        command = (setpoint.brake, setpoint.position)
        if command == self._sent[number]:
            return
        self._sent[number] = command
        place = setpoint.position
        accepts = self._latches[number].accepts(place, brake=setpoint.brake)
        if setpoint.brake:
            self._fleet.brake(number)
        elif accepts:
            self._fleet.goto(number, place.x, place.y, place.z)

    def _farthest(self, number: int, motion: Floats) -> float:
        """Return how far beyond its cage (m) one vehicle would get if it braked now."""
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
    # Neighbouring seeds still give unrelated gusts.
    return DynamicsParams(start=StartParams(*mission.start), wind=wind, seed=mission.seed % 2**31)
