"""Simulation of the vehicle's process: boots, the setpoints that each follows, poses, landings.

A vehicle that cannot hold itself stops and lands where it is, whatever safety requests; on the
floor it can be blown no farther. It decides this by itself, as autopilots do: it alone knows its
setpoint and estimates the wind, and a stopped vehicle would go on drifting. There are two signs:
the mean wind that its controller knows is beyond its envelope, or it is far off its setpoint, e.g.
in a wind that nobody told. It lies on the floor as it fell until the known wind is one that it can
hold; then it stands level, and flies to a new goal only.
"""

import math
import os
import time
from collections import deque
from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import structs

from quadctl.schemas.messages import (
    BodyRates,
    Pose,
    Poses,
    Position,
    Quaternion,
    Setpoint,
    Velocity,
)
from quadctl.schemas.params import FROM_STANDSTILL, DynamicsParams, Params
from quadctl.schemas.topics import POSE, POSE_SLOW, POSES, SETPOINT
from quadctl.services.airspace import airworthiness
from quadctl.services.dynamics.compiler import BackgroundCompiler
from quadctl.services.dynamics.faulty_pose import FaultyPose
from quadctl.services.dynamics.formation import Formation
from quadctl.services.dynamics.vehicle import Vehicle
from quadctl.services.runtime.errors import Refused
from quadctl.services.runtime.executor import Executor
from quadctl.services.runtime.goal_latch import GoalLatch
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.params.names import flatten


def still_in_force(flown: DynamicsParams, wanted: DynamicsParams) -> dict[str, Any]:
    """Return the values that a vehicle flies by, by name, of those that wait for a standstill."""
    before, after = (
        dict(flatten(msgspec.to_builtins(each), "dynamics")) for each in (flown, wanted)
    )
    return {
        name: value
        for name, value in before.items()
        if name.startswith(FROM_STANDSTILL) and value != after[name]
    }


_ASTRAY = 2.0
"""Distance (m) from its setpoint at which a vehicle cannot hold itself; the strongest gusts of a
campaign, and motors at half their thrust, move it by less than 1 m."""
_DROP = 0.1
"""Height (m) from which such a vehicle drops: blown along, it might not come nearer to the floor."""
_STEPS_PER_SECOND = 1000
_STEPS_PER_PERIOD = round(_STEPS_PER_SECOND / POSE_SLOW.hz)
_BATCHED = 0.25
"""Poses (simulated s) that go out together at full speed, to those that wait for none: each message wakes them."""
_REPUBLISH = 0.25
"""Time (s) after which, in lock-step, an unanswered pose is published again."""
_AT_REST = 1.0
"""Ticks a second of a vehicle at rest among others: a process that begins meanwhile needs a pose."""
_SILENCE = 5.0
"""Silence of safety (s) after which, in lock-step, a warning is logged."""


class Simulation:
    """Boots of the vehicle, one after another, and the setpoints that each follows."""

    def __init__(
        self,
        node: Node,
        params: Params,
        compiler: BackgroundCompiler | None = None,
        formation: Formation | None = None,
    ) -> None:
        """Start the first boot; fly by the `compiler`, if any, once it has a model, and in the `formation`."""
        self._node, self._params = node, params.dynamics
        self._in_lockstep = params.dynamics.in_lockstep
        self._compiler, self._formation = compiler, formation
        self._reported = FaultyPose(params.dynamics.fault)
        self._boots: set[str] = set()
        self._limited: list[str] = []
        self._judged: DynamicsParams | None = None
        self._unheld = ""
        """Reason why a vehicle with the parameters judged last cannot hold itself, or empty."""
        self._unsent: list[Pose] = []
        self._batch: list[Pose] = []
        """Poses that POSE, and POSES, lack so far."""
        self.boot()
        self.poses = node.publisher(POSE, lambda: params.dynamics.rate, together=True)
        self._due_poses = node.publisher(POSE_SLOW, together=True)
        self._part = self._due_poses.part
        self._all_poses = node.publisher(POSES) if self._in_lockstep else None
        self._poses_per_tick, self._last_tick = 1, 0.0
        # Setpoints take effect at the next pose, so they need not wake the node before it.
        self._setpoints = node.listen(SETPOINT, self._on_setpoint, wakes=lambda: self._rest > 0)
        self._arrived: deque[tuple[float, Setpoint]] = deque()
        if self._part:
            node.executor.add_poller(self._pass_rest)

    def reset(self, name: str) -> None:
        """Start a new boot, by a given or a random name, and publish it."""
        if name in self._boots:
            raise Refused(f"there was a boot named {name} already", "choose another name, or none")
        self._publish_batch()
        self.boot(name)
        self.publish()
        self.advance_time()
        self._node.retime()

    def boot(self, name: str = "") -> None:
        """Put the vehicle on its start, as a new boot that ignores old setpoints."""
        self.vehicle = Vehicle(self._params)
        self._boot, self._seq, self._period = name or os.urandom(4).hex(), 0, -1
        self._boots.add(self._boot)
        self._answered, self._braked, self._last_setpoint = -1, True, 0.0
        self._asked = self._rest = self._rested = 0
        """Number of the last pose sent; its step if the vehicle repeats it, else 0; and the beat up to which."""
        self._wakes = False
        self._latch, self._ignores, self._alone = GoalLatch(), False, False
        self._lands = False
        self._followed: Setpoint | None = None
        """Setpoint that the vehicle follows, if it has followed it since."""
        self._command: Setpoint | None = None
        """Setpoint to be obeyed before the vehicle flies on."""
        self._mark()
        self._node.log.info("boot %s", self._boot)
        self._log_limits()

    def configure(self) -> None:
        """Take the parameters' new values; the start counts from the next boot."""
        self.vehicle.configure(self._params)
        self._wakes = True
        if self._lands:
            # Safety judges the same change, and its next goal may come before the next pose.
            self._hold_or_land()
        self._log_limits()

    def _log_limits(self) -> None:
        params = self._params
        now = airworthiness.limited(params.vehicle, params.control, params.wind)
        for line in now:
            if line not in self._limited:
                self._node.log.warning(line)
        self._limited = now

    def in_force(self) -> dict[str, Any]:
        """Return the values still in force, by name, of parameters that wait for a standstill."""
        return still_in_force(self.vehicle.in_force, self._params)

    def tick_rate(self) -> float:
        """Return the rate of the vehicle's own next ticks, Hz.

        While nobody subscribes to the poses between those that safety answers, or at full speed, a tick
        flies all of them at once: each tick or wake costs more than the flight between two poses.
        Among others it then flies at the ticks of its formation.
        """
        rate, speed = self._params.rate, self._params.speed
        if self._in_lockstep and speed:
            self._poses_per_tick = 1
            return rate * speed
        if self._in_lockstep:
            self._poses_per_tick = max(1, int(rate / POSE_SLOW.hz))
            return math.inf
        if self._rest and not (self._wakes or self._is_seen):
            return self._alone_at(_AT_REST)
        waits = not self._answer_is_due or rate % POSE_SLOW.hz or self.poses.has_subscribers
        self._poses_per_tick = 1 if waits else int(rate / POSE_SLOW.hz)
        rate /= self._poses_per_tick
        if self._formation and rate == POSE_SLOW.hz:
            self._formation.add(self)
            return _AT_REST
        return self._alone_at(rate)

    def _alone_at(self, rate: float) -> float:
        if self._formation:
            self._formation.remove(self)
        return rate

    def tick(self, now: float) -> None:
        """Fly up to a time on the monotonic clock, s, unless its formation does."""
        if not (self._formation and self in self._formation):
            self.fly(now)

    def fly(self, now: float) -> None:
        """Fly up to a time on the monotonic clock, s."""
        for steps in self.flights(now):
            self.vehicle.advance(steps)

    def flights(self, now: float) -> Iterator[int]:
        """Yield how many steps to fly, for the caller to do so, up to a time (monotonic s), as if each pose had its own tick."""
        poses = self._poses_per_tick
        if self._rest and self._part:
            if self._part.beats == self._rested:
                return  # woken within the period of its last pose
            # The first tick afterwards is for the rest's last period, whatever the rate is by now.
            poses, self._rest = round(self._params.rate / POSE_SLOW.hz), 0
        while poses and not self._node.stopping:
            poses -= 1
            then = now - poses / self._params.rate
            self._prepare(then)
            yield self._steps(1)
            self._arrive(1)
            self._last_tick = then
            if poses and self._has_no_event(now):
                self._last_tick = now
                yield self._steps(poses)
                self._arrive(poses)
                poses = 0

    def _has_no_event(self, now: float) -> bool:
        """Return whether nothing can happen at the poses up to a time (monotonic s), so that they are one flight."""
        return not (
            self._in_lockstep
            or self.poses.has_subscribers
            or (self._arrived and self._arrived[0][0] <= now)
            or (now - self._last_setpoint > self._params.setpoint_timeout and not self._braked)
            or self._params.fault.pose != "none"
            or self.vehicle.has_waiting
        )

    @property
    def executor(self) -> Executor:
        """Return the loop of the vehicle's node."""
        return self._node.executor

    @property
    def beats(self) -> bool:
        """Return whether its poses are the beats of its process."""
        return self._node.is_first

    @property
    def rests(self) -> bool:
        """Return whether the vehicle repeats its pose until it gets another setpoint."""
        return self._rest > 0

    @property
    def _is_seen(self) -> bool:
        """Return whether anybody but the run's own processes receives the poses."""
        return self.poses.has_subscribers or self._due_poses.has_subscribers

    @property
    def is_received(self) -> bool:
        """Return whether anybody receives the poses that safety answers."""
        return self._due_poses.has_subscribers or bool(self._part and self._part.is_received)

    def _may_rest(self) -> bool:
        """Return whether the vehicle only repeats this pose until it gets another setpoint.

        The first vehicle never rests: its poses are the beats by which the others count.
        """
        return (
            not self.beats
            and self.vehicle.is_still
            and self._poses_per_tick == self._params.rate / POSE_SLOW.hz
            and self._answered >= self._asked
            and self._params.fault.pose == "none"
            and not (self._lands or self._unheld or self._is_seen)
        )

    def _pass_rest(self) -> None:
        """Let the periods pass that a vehicle at rest has repeated its pose, but for the present one."""
        if self._rest and self._part and (passed := self._part.beats - self._rested - 1) > 0:
            self._rested += passed
            self._seq += passed * self._rest
            self.vehicle.rest(passed * _STEPS_PER_PERIOD)
            self._mark()
            # No setpoint answers a repetition, so none is missing.
            now, passing = time.monotonic(), passed / POSE_SLOW.hz
            self._follow_until(now)
            self._last_setpoint = min(self._last_setpoint + passing, now)
            self._last_tick += passing
            self._reported.through(self._pose())
            self.advance_time()

    def _wake(self) -> None:
        """End a rest with the next tick, and let that come soon."""
        self._wakes = True
        self._node.retime()

    def _prepare(self, now: float) -> None:
        """Follow the setpoints up to a time (monotonic s), or brake without any."""
        params = self._params
        if self._in_lockstep:
            self._wait_for_safety()
            self._obey()
        else:
            self._follow_until(now)
            self._obey()
            # After a delay of this loop itself, the setpoints in its queue count first.
            own = now - self._last_tick
            if now - self._last_setpoint > params.setpoint_timeout > own or (
                self._last_tick and own > max(params.grace, params.setpoint_timeout)
            ):
                self._brake()

    def _steps(self, poses: int) -> int:
        """Return the steps up to the pose after so many, which the vehicle flies compiled if it can."""
        if self._compiler and (model := self._compiler.model):
            self.vehicle.fly = model
        return poses * round(_STEPS_PER_SECOND / self._params.rate)

    def _arrive(self, poses: int) -> None:
        """Publish the pose after so many."""
        self._mark()
        if self._answer_is_due:
            self._hold_or_land()
        self._seq += poses
        if self._part and self._answer_is_due and self.beats:
            self._part.beat()
        self.publish()
        self.advance_time()

    def _hold_or_land(self) -> None:
        """Begin or continue a landing if the vehicle cannot hold itself; end it when it can."""
        vehicle = self.vehicle
        flown = vehicle.in_force
        if flown is not self._judged:
            # A change replaces them; judging 20 times a second would cost each hover.
            self._judged = flown
            self._unheld = airworthiness.why_not_held(flown.vehicle, flown.control, flown.wind)
        why = self._unheld
        still = vehicle.standing or vehicle.is_still
        if not (why or still or math.dist(vehicle.position, vehicle.setpoint) < _ASTRAY):
            why = f"the vehicle is {_ASTRAY:g} m off its setpoint"
        if why and not self._lands:
            self._node.log.warning("stopped and landing, no goal is taken: %s", why)
            self._lands = self._braked = self._ignores = True
            self._latch.stopped()
            vehicle.brake()
            x, y, _ = vehicle.goal
            vehicle.goto(x, y, 0.0)
        elif self._lands and not vehicle.standing and vehicle.position[2] < _DROP:
            vehicle.stand()
        elif self._lands and vehicle.standing and not why:
            self._node.log.warning("the vehicle can hold itself again: it takes a new goal")
            self._lands = False
            vehicle.stand()

    def advance_time(self) -> None:
        """Execute the calls that were held for this pose, with all poses up to it published."""
        self._node.advance_sim_time(self._boot, self._stamp, self._publish_batch)

    def publish(self) -> None:
        """Publish the current pose.

        At full speed, poses that need no answer go out with the next one that does: together they
        wake each process on their way once, not five times. Safety's pose goes last: nobody may
        receive a decision before the pose that it is about. POSES is for those that do not mind.
        """
        has_subscribers = self.poses.has_subscribers
        is_seen = self._in_lockstep or has_subscribers
        if not (is_seen or self._answer_is_due or self._params.fault.pose != "none"):
            return  # a pose for nobody would take half as long as its flight
        pose = self._reported.through(self._pose())
        is_time = self._params.speed != 0 or self._answer_is_due
        if is_seen:
            self._unsent.append(pose)
        if self._all_poses:
            self._batch.append(pose)
        if is_time and has_subscribers:
            self._publish_unsent()
        repeats = self._asked == self._seq
        if self._answer_is_due:
            self._rest = self._poses_per_tick if self._part and self._may_rest() else 0
            self._due_poses.put(pose, self._rest)
            self._asked = self._seq
            if self._part:
                self._rested, self._wakes = self._part.beats, False
        # Nobody waits for the rest, but in lock-step somebody may have subscribed just now.
        if is_time:
            self._publish_unsent()
        is_whole = self._answer_is_due and len(self._batch) >= _BATCHED * self._params.rate
        if self._params.speed != 0 or repeats or is_whole:
            self._publish_batch()

    def _publish_unsent(self) -> None:
        for pose in self._unsent:
            self.poses.put(pose)
        self._unsent.clear()

    def _publish_batch(self) -> None:
        if self._batch and self._all_poses:
            self._all_poses.put(Poses(self._batch.copy()))
        self._batch.clear()

    def _pose(self) -> Pose:
        state = self.vehicle.state
        return Pose(
            self._boot, self._seq, self._stamp, Position(*state[:3]), Velocity(*state[3:6]),
            Quaternion(*state[6:10]), BodyRates(*state[10:13]),
        )  # fmt: skip

    def _brake(self) -> None:
        """Come to a hover at the stopping point."""
        if not self._braked and not self._lands:
            self._braked = True
            self._node.log.warning(
                "no setpoint for %g s: braking to a hover", self._params.setpoint_timeout
            )
            self.vehicle.brake()
            self._latch.stopped()
            self._alone = True

    def _wait_for_safety(self) -> None:
        """In lock-step, stop the clock until a due answer comes; it takes effect at its pose."""
        if not self._answer_is_due:
            return
        silence = 0.0
        while not self._node.wait_for(self._is_answered, _REPUBLISH):
            if self._node.stopping:
                return
            silence += _REPUBLISH
            if _SILENCE <= silence < _SILENCE + _REPUBLISH:
                self._node.log.warning("no setpoint for %g s: the clock is stopped", _SILENCE)
            # The pose or its answer was lost with a hub or a safety that restarted.
            self.publish()
        if silence >= _SILENCE:
            self._node.log.warning("setpoints are back: the clock runs again")

    def _mark(self) -> None:
        """Find out whether safety answers this pose: the first in a period of the setpoint, whatever the rate was."""
        before, self._period = self._period, SETPOINT.period(self._stamp)
        self._answer_is_due = self._period != before

    @property
    def _stamp(self) -> float:
        return self.vehicle.steps / _STEPS_PER_SECOND

    def _is_answered(self) -> bool:
        self._follow_until(math.inf)
        return self._answered >= self._seq

    def _on_setpoint(self, setpoint: Setpoint) -> None:
        self._arrived.append((self._setpoints.received, setpoint))
        if self._rest and not self._follows_already(setpoint):
            self._wake()

    def _follow_until(self, now: float) -> None:
        """Follow the setpoints that arrived up to a time on the monotonic clock, s."""
        while self._arrived and self._arrived[0][0] <= now:
            self._follow(*self._arrived.popleft())

    def _follow(self, received: float, setpoint: Setpoint) -> None:
        if setpoint.boot != self._boot:
            return
        silence = received - self._last_setpoint
        self._answered, self._last_setpoint = setpoint.for_seq, received
        # Safety sees the silence only by its poses, and may measure a little less.
        if self._alone and silence <= self._params.grace + self._params.setpoint_timeout:
            self._latch.resumed()
            self._node.log.info("setpoints are back after %.2g s: flying on", silence)
        self._alone = False
        if self._follows_already(setpoint):
            return
        accepts = self._latch.accepts(setpoint.position, brake=setpoint.brake)
        if self._lands:
            self._latch.stopped()
            return
        if not (accepts or self._ignores):
            self._node.log.warning("setpoints are back: hovering until a new goal is requested")
        self._ignores = not accepts
        if setpoint.brake or accepts:
            self._command = setpoint
        self._braked = setpoint.brake or not accepts
        self._followed = setpoint

    def _obey(self) -> None:
        """Command the vehicle by the newest setpoint; one to brake just before it was for the latch alone."""
        if command := self._command:
            self._command = None
            if command.brake:
                self.vehicle.brake()
            else:
                self.vehicle.goto(*structs.astuple(command.position))

    def _follows_already(self, setpoint: Setpoint) -> bool:
        """Return whether this setpoint repeats the one that the vehicle follows, in all but its number."""
        last = self._followed
        return (
            last is not None
            and not (self._ignores or self._lands)
            and self._braked is setpoint.brake is last.brake
            and setpoint.position == last.position
        )
