"""Batch of flights, flown period by period; only the monitors that a pose may move are called."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from functools import partial
from hashlib import sha256
from itertools import combinations
from math import inf

import numpy as np
from msgspec.structs import replace

from quadctl.schemas.params import DynamicsParams, Params
from quadctl.schemas.topics import SETPOINT
from quadctl.services.airspace.separation import allowed
from quadctl.services.campaign.flight import DEPTH, SimulatedFlight, serve
from quadctl.services.campaign.mission import Mission, faults_of
from quadctl.services.campaign.score import Flown, LaunchCage, Score, farthest
from quadctl.services.campaign.vehicles import VehicleBatch
from quadctl.services.campaign.watch import MOVED, ROWS, SLACK, Floats
from quadctl.services.dynamics.simulation import still_in_force
from quadctl.services.runtime.goal_latch import GoalLatch
from quadctl.services.safety.model import State
from quadctl.services.safety.traffic import Traffic

_STEPS = round(1000 / SETPOINT.hz)
"""Steps of 1 ms in a period."""
_SAMPLES = 5
"""Samples of the excursion in a period."""
_RATCHET = 10
"""Periods between checks of how much nearer a vehicle outside has come."""
_SLOW = 0.3
"""Speed (m/s) on an axis below which a vehicle outside is checked."""

MakeFleet = Callable[[Sequence[DynamicsParams]], VehicleBatch]


class Batch:
    """Independent flights of one length, each with as many vehicles."""

    def __init__(
        self, missions: Sequence[Mission], make: MakeFleet, *, vehicles: int = 1, log: bool = False
    ) -> None:
        """Put each vehicle at rest on its start; keep log lines only with `log`.

        The missions of a flight's vehicles are neighbours.
        """
        self.missions, self._vehicles = missions, vehicles
        self._fleet = make([mission.dynamics for mission in missions])
        self.lanes = [
            SimulatedFlight(mission, log=log, name=f"uav{number % vehicles}", traffic=traffic)
            for first in range(0, len(missions), vehicles)
            for traffic in [Traffic()]
            for number, mission in enumerate(missions[first : first + vehicles], first)
        ]
        for number, lane in enumerate(self.lanes):
            if lane.served:
                self._serve_dynamics(number)
        count = len(missions)
        self._score = Score(count, vehicles)
        # All monitors are wanted in the first period.
        self._notes, self._found = np.zeros((len(ROWS), count)), np.empty(count, dtype=np.int64)
        self._notes[MOVED] = -inf
        self._sent: list[object] = [None] * count
        self._latches = [GoalLatch() for _ in missions]
        self._unscored = [True] * count
        self._periods = round(missions[0].seconds * SETPOINT.hz)
        self._track = np.empty((self._periods + 1, 6, count))

    def _serve_dynamics(self, number: int) -> None:
        params, fleet = deepcopy(self.missions[number].dynamics), self._fleet
        self.lanes[number].served["dynamics"] = serve(
            "dynamics",
            Params(dynamics=params),
            partial(self._configure, number, params),
            lambda: still_in_force(fleet.in_force(number), params),
        )

    def _configure(self, number: int, params: DynamicsParams) -> None:
        self._fleet.configure(number, params)
        self.lanes[number].fly_with(params)

    def fly_near(self) -> list[Flown]:
        """Fly all to their end; a flight that stays inside has its distance from a wall, negative."""
        self._score.nearest = nearest = np.full(len(self.lanes), -np.inf)
        return [
            flight
            if flight.worst_excursion
            else replace(flight, worst_excursion=nearest[number].item())
            for number, flight in enumerate(self.fly())
        ]

    def fly(self) -> list[Flown]:
        """Fly all to their end."""
        motion = self._fleet.fly(0, 1)[0]
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
                motion = self._advance(period)[-1]
        return [self._flown(first) for first in range(0, len(self.lanes), self._vehicles)]

    def path(self, number: int) -> Floats:
        """Return the positions of a flight that is over, m, (periods + 1, 3)."""
        return self._track[:, :3, number]

    def awake(self, period: int, motion: Floats) -> list[int]:
        """Return the flights with a monitor that must run."""
        last, look = self._track[max(period - 1, 0)], self._fleet.loops.look
        count = look(self._notes, motion, last, period, self._found)
        found: list[int] = self._found[:count].tolist()
        return found

    def _advance(self, period: int) -> Floats:
        """Fly one period, keep the score, and return the motions."""
        motions = self._fleet.fly(_STEPS // _SAMPLES, _SAMPLES)
        times = [(period + sample / _SAMPLES) / SETPOINT.hz for sample in range(1, _SAMPLES + 1)]
        self._score.sample(motions, times, self._fleet.loops)
        return motions

    def _step(self, number: int, period: int, motion: Floats) -> None:
        lane = self.lanes[number]
        here = motion[:, number].tolist()
        if lane.seen < period - 1:
            self._catch_up(number, lane, period)
        lane.monitor.moved = self._notes[MOVED, number] / SETPOINT.hz
        lane.see(period, here)
        if lane.act(period):
            # While no setpoint reaches a vehicle, its excursion does not count.
            self._unscored[number] = True
            self._score.free(number)
        self._send_setpoint(number, lane)
        if self._unscored[number] and self._sent[number] is not None and not lane.is_astray:
            self._unscored[number] = False
            if lane.cage_on:
                self._score.confine(number, lane.size, self._farthest(number, motion))
        self._note(number, lane)

    def _catch_up(self, number: int, lane: SimulatedFlight, period: int) -> None:
        """Show a monitor the poses that count although they changed nothing when they came."""
        track, seen = self._track[:, :, number], lane.seen
        moved = int(max(self._notes[MOVED, number], 0))
        if moved < period and lane.monitor.situation.state is State.MOVING:
            # It stands still: since when?
            for pose in (moved, max(moved, seen) + 1):
                if seen < pose < period:
                    lane.track(pose, track[pose].tolist())
        # The next pose is compared with it.
        lane.skip(period - 1, track[period - 1].tolist())
        # Poses came all the time.
        lane.monitor.tracking.stamp = (period - 1) / SETPOINT.hz

    def _note(self, number: int, lane: SimulatedFlight) -> None:
        """Note the conditions that a monitor waits for from now on."""
        s, params = lane.monitor.situation, lane.params
        goal, size = s.goal, params.virtual_cage
        # One assignment: writing them one by one would take ten times as long.
        self._notes[:, number] = (
            lane.wanted, lane.seen, s.state is State.MOVING, s.stops, lane.due,
            round(lane.monitor.moved * SETPOINT.hz) if lane.monitor.moved >= 0 else -inf,
            params.acceptance_range + SLACK,
            params.max_deceleration, params.reaction, params.max_speed / SETPOINT.hz,
            s.beyond if s.cage_on else inf, lane.monitor.margin - SLACK,
            *goal, size.x, size.y, size.z,
        )  # fmt: skip

    def _send_setpoint(self, number: int, lane: SimulatedFlight) -> None:
        """Send the setpoint to the vehicle, or brake it after too long without one."""
        setpoint, now = lane.setpoint(), lane.diary.now
        params = self.missions[number].dynamics
        if not lane.sound and self._strays(number, lane):
            return
        if now < lane.mute_until:
            if now - lane.last_sent > params.setpoint_timeout:
                self._fleet.brake(number)
                self._latches[number].stopped()
            self._sent[number] = None
            return
        if (
            self._sent[number] is None
            and now - lane.last_sent <= params.grace + params.setpoint_timeout
        ):
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

    def _strays(self, number: int, lane: SimulatedFlight) -> bool:
        """Let a vehicle that ignores its setpoints fly elsewhere; return whether it does."""
        astray = ("astray", lane.astray_to)
        if lane.is_astray:
            if self._sent[number] != astray:
                self._sent[number] = astray
                if lane.astray_to:
                    self._fleet.goto(number, *lane.astray_to)
                else:
                    self._fleet.brake(number)
            self._unscored[number] = True
            self._score.free(number)
        elif self._sent[number] == astray:
            # It brakes before it obeys again.
            self._fleet.brake(number)
            self._sent[number] = None
        return lane.is_astray

    def _farthest(self, number: int, motion: Floats) -> float:
        """Return how far beyond its cage (m) one vehicle would get if it braked now."""
        here = motion[:3, number].tolist()
        return farthest([here, *self._fleet.room(number)], self.lanes[number].size)

    def worst(self, first: int) -> int:
        """Return the vehicle with the worst excursion in the flight that begins with this one."""
        return first + int(self._score.worst[first : first + self._vehicles].argmax())

    def _flown(self, first: int) -> Flown:
        """Return the figures of the flight that begins with this vehicle."""
        whole = self._flown_alone(first)
        if self._vehicles == 1:
            return whole
        flown = [whole, *map(self._flown_alone, range(first + 1, first + self._vehicles))]
        counts = {
            name: sum((Counter(getattr(each, name)) for each in flown), Counter())
            for name in ("transitions", "refusals", "stops", "guards", "faults")
        }
        lanes = self.lanes[first : first + self._vehicles]
        if all(lane.healthy for lane in lanes):
            flown[0].violations.extend(self._too_near(first))
        worst = flown[self.worst(first) - first]
        flight = first // self._vehicles
        separation = self._score.separation[flight].item(), self._score.separation_at[flight].item()
        return replace(
            whole,
            **counts,
            worst_excursion=worst.worst_excursion,
            at=worst.at,
            arrivals=[seconds for each in flown for seconds in each.arrivals],
            violations=[
                f"uav{n}: {what}" for n, each in enumerate(flown) for what in each.violations
            ],
            hash=sha256("".join(each.hash for each in flown).encode()).hexdigest(),
            separation=separation,
        )

    def _too_near(self, first: int) -> Iterator[str]:
        """Yield the pairs of a flight's vehicles that came nearer than safety allows, if in still air."""
        places = self._track[:, :3, first : first + self._vehicles]
        kept = [lane.params.separation for lane in self.lanes[first : first + self._vehicles]]
        for one, other in combinations(range(self._vehicles), 2):
            across, tall = allowed(kept[one], kept[other])
            if not across:
                continue
            way = places[:, :, one] - places[:, :, other]
            share = np.hypot(np.hypot(way[:, 0], way[:, 1]) / across, way[:, 2] / tall)
            at = int(share.argmin())
            if share[at] < min(share[0], 1 - DEPTH / across):
                yield f"{share[at]:.3f} of the distance to keep from uav{other} at {at / SETPOINT.hz:.2f} s"

    def _flown_alone(self, number: int) -> Flown:
        lane, mission = self.lanes[number], self.missions[number]
        diary, margin = lane.diary, lane.monitor.margin
        worst, at = self._score.worst[number].item(), self._score.at[number].item()
        if worst > margin:
            diary.now = at
            diary.violated(f"more than {margin:g} m beyond the cage")
        diary.digest.update(repr(worst).encode())
        diary.digest.update(np.ascontiguousarray(self._track[:, :, number]).data)
        wind, faults = mission.dynamics.wind.mean, faults_of(mission.rows)
        return Flown(
            mission.seed, LaunchCage.of(mission.safety), worst, at, diary.transitions, diary.refusals,
            diary.stops, _counted(diary.fired), (wind.x, wind.y), faults, diary.arrivals, diary.violations,
            diary.digest.hexdigest(),
        )  # fmt: skip


def _counted(rules: list[object]) -> dict[str, int]:
    """Return how often each rule stands in a list, by its text, which is slow to make."""
    texts = {id(rule): str(rule) for rule in {id(rule): rule for rule in rules}.values()}
    return Counter(texts[id(rule)] for rule in rules)
