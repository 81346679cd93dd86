"""Simulation of the vehicle's process: its boots, the setpoints that each follows, its poses."""

import math
import os
from collections import deque
from collections.abc import Callable
from typing import Any

import msgspec
from msgspec import structs

from quadctl.schemas.messages import BodyRates, Pose, Position, Quaternion, Setpoint, Velocity
from quadctl.schemas.params import FROM_STANDSTILL, FlightFaultParams, Params
from quadctl.schemas.topics import POSE, SETPOINT
from quadctl.services.dynamics.vehicle import Fly, Vehicle
from quadctl.services.runtime.errors import Refused
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.params.names import flatten


class GoalLatch:
    """After a brake of its own the vehicle goes on to the goal that it had within a grace alone.

    After a longer silence somebody may have come near. Then it goes on for what was asked of safety
    since: for another goal, or after a setpoint to brake, which says that safety knows of the stop.
    """

    def __init__(self) -> None:
        self._goal: Position | None = None
        self._void: Position | None = None

    def stopped(self) -> None:
        """The vehicle brakes because it hears nothing."""
        self._void = self._goal

    def resumed(self) -> None:
        """Go on with the goal: setpoints were missing for no longer than the grace."""
        self._void = None

    def accepts(self, goal: Position, *, brake: bool) -> bool:
        """Whether a setpoint is followed."""
        if not brake and goal == self._void:
            return False
        self._goal, self._void = None if brake else goal, None
        return True


_LONGEST = 10.0
"""Seconds of poses that are kept; `dynamics.fault.delay` asks for no more."""
_SLACK = 1e-6
"""What times that are multiples of a period may be off by rounding, s."""


class FaultyPose:
    """Hands poses on as the fault in force leaves them; a changed one counts at once."""

    def __init__(self, params: FlightFaultParams) -> None:
        self._params = params
        self._past: deque[Pose] = deque()
        self._told: Pose | None = None

    def through(self, pose: Pose) -> Pose:
        """What is told in place of the true pose."""
        if self._params.pose == "none":
            self._past.clear()
        else:
            self._keep(pose)
            pose = self._faulty(pose)
        self._told = pose
        return pose

    def _faulty(self, pose: Pose) -> Pose:
        match self._params.pose:
            case "frozen":
                return self._told or pose
            case "delayed":
                then = pose.stamp - self._params.delay + _SLACK
                return next(
                    (old for old in reversed(self._past) if old.stamp <= then), self._past[0]
                )
        place = structs.replace(pose.position, x=pose.position.x + self._params.jump)
        return structs.replace(pose, position=place)

    def _keep(self, pose: Pose) -> None:
        if self._past and self._past[-1].boot != pose.boot:
            self._past.clear()
        self._past.append(pose)
        while self._past[0].stamp < pose.stamp - _LONGEST:
            self._past.popleft()


_STEPS_PER_SECOND = 1000
_ASK_AGAIN = 0.25
"""In lock-step, a pose that is not answered is published again after this (s)."""
_SILENCE = 5.0
"""In lock-step, a safety silent for longer (s) is complained of."""


class Simulation:
    """One boot after another of the vehicle, and the setpoint that each follows."""

    def __init__(
        self, node: Node, params: Params, faster: Callable[[], Fly | None] | None = None
    ) -> None:
        """`faster` is asked before each flight of a pose's time, until it has something faster."""
        self._node, self._params = node, params.dynamics
        self._faster = faster
        self._reported = FaultyPose(params.dynamics.fault)
        self._boots: set[str] = set()
        self._unsent: list[Pose] = []
        self.boot()
        self.poses = node.publisher(
            POSE, lambda: params.dynamics.rate, waits=params.dynamics.speed != 1
        )
        self._setpoints = node.listen(SETPOINT, self._follow)
        # They are followed from the next tick on, so they need not wake us before it.
        self._setpoints.defer_wakeups(math.inf)

    def reset(self, name: str) -> None:
        """Begin anew, by a given name or one of its own, and show it."""
        if name in self._boots:
            raise Refused(f"a boot was named {name} already", "name another, or none")
        self.boot(name)
        self.publish()
        self.tell_time()

    def boot(self, name: str = "") -> None:
        """Stand at the start, as a new boot that no old setpoint moves."""
        self._vehicle, self._is_fast = Vehicle(self._params), False
        self._boot, self._seq = name or os.urandom(4).hex(), 0
        self._boots.add(self._boot)
        self._answered, self._braked, self.heard = -1, True, 0.0
        self._latch, self._ignores, self._alone = GoalLatch(), False, False
        self._node.log.info("boot %s", self._boot)

    def configure(self) -> None:
        """The parameters have new values; the start counts from the next boot."""
        self._vehicle.configure(self._params)

    def in_force(self) -> dict[str, Any]:
        """Return the values that the vehicle still flies by, by name, of those that wait."""
        flown, wanted = (
            dict(flatten(msgspec.to_builtins(each), "dynamics"))
            for each in (self._vehicle.in_force, self._params)
        )
        return {
            name: value
            for name, value in flown.items()
            if name.startswith(FROM_STANDSTILL) and value != wanted[name]
        }

    def advance(self) -> None:
        """Fly one pose's time, and publish the pose."""
        if self._faster and not self._is_fast and (fly := self._faster()):
            self._vehicle.fly, self._is_fast = fly, True
        self._vehicle.advance(round(_STEPS_PER_SECOND / self._params.rate))
        self._seq += 1
        self.publish()
        self.tell_time()

    def tell_time(self) -> None:
        """Have the calls executed that were held for this pose."""
        self._node.advance_sim_time(self._boot, self._stamp)

    def publish(self) -> None:
        """Publish the pose as it is.

        As fast as it goes, those that nobody answers go out with the next one that is answered:
        sent together they cost each process on their way one wake, where they would cost five.
        """
        px, py, pz, vx, vy, vz, qw, qx, qy, qz, wx, wy, wz, _, _, _, _ = self._vehicle.state
        pose = Pose(
            self._boot,
            self._seq,
            self._stamp,
            Position(px, py, pz),
            Velocity(vx, vy, vz),
            Quaternion(qw, qx, qy, qz),
            BodyRates(wx, wy, wz),
        )
        self._unsent.append(self._reported.through(pose))
        if self._params.speed != 0 or self._answer_is_due:
            for pose in self._unsent:
                self.poses.put(pose)
            self._unsent.clear()

    def brake(self) -> None:
        """Come to a hover at the stopping point."""
        if not self._braked:
            self._braked = True
            self._node.log.warning(
                "no setpoint for %g s: braking to a hover", self._params.setpoint_timeout
            )
            self._vehicle.brake()
            self._latch.stopped()
            self._alone = True

    def wait_for_safety(self) -> None:
        """In lock-step: stop the clock until the last pose is answered, where an answer is due.

        What safety says to a pose then takes effect at that pose, whatever the speed.
        """
        if not self._answer_is_due:
            return
        silence = 0.0
        while not self._node.wait_for(lambda: self._answered >= self._seq, _ASK_AGAIN):
            if self._node.stopping:
                return
            silence += _ASK_AGAIN
            if _SILENCE <= silence < _SILENCE + _ASK_AGAIN:
                self._node.log.warning("no setpoint for %g s: the clock stands still", _SILENCE)
            # The pose or its answer was lost with a hub or a safety that has been restarted.
            self.publish()
        if silence >= _SILENCE:
            self._node.log.warning("setpoints again: the clock goes on")

    @property
    def _answer_is_due(self) -> bool:
        """Whether safety answers this pose: the first of a period of its own."""
        period = 1 / self._params.rate
        return SETPOINT.period(self._stamp) != SETPOINT.period(self._stamp - period)

    @property
    def _stamp(self) -> float:
        return self._vehicle.steps / _STEPS_PER_SECOND

    def _follow(self, setpoint: Setpoint) -> None:
        if setpoint.boot != self._boot:
            return
        silence = self._setpoints.received - self.heard
        self._answered, self.heard = setpoint.for_seq, self._setpoints.received
        # Safety, which sees the silence only by its poses, may find it a little shorter.
        if self._alone and silence <= self._params.grace + self._params.setpoint_timeout:
            self._latch.resumed()
            self._node.log.info("setpoints again after %.2g s: going on", silence)
        self._alone = False
        accepts = self._latch.accepts(setpoint.position, brake=setpoint.brake)
        if not (accepts or self._ignores):
            self._node.log.warning("setpoints again: hovering until another goal is asked for")
        self._ignores = not accepts
        if setpoint.brake:
            self._vehicle.brake()
        elif accepts:
            self._vehicle.goto(*structs.astuple(setpoint.position))
        self._braked = setpoint.brake or not accepts
