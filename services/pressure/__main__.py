"""Process of the barometer: timing and publication of its readings, and calibration."""

import logging
import random
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from quadctl.schemas.messages import Pose, Poses
from quadctl.schemas.params import Params
from quadctl.schemas.services import CalibrateRequest, CalibrateResponse
from quadctl.schemas.topics import CALIBRATE, POSE, POSE_SLOW, POSES, PRESSURE, Topic, period
from quadctl.services.pressure import iio
from quadctl.services.pressure.barometer import Barometer, NoSample, SensorFaults
from quadctl.services.pressure.iio import has_pressure, hectopascals
from quadctl.services.pressure.simulated import Simulated
from quadctl.services.runtime.bus.pubsub import Subscription
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.errors import NotReady, QuadctlError
from quadctl.services.runtime.node import FIRST_POSE, Node
from quadctl.services.runtime.params.load import launch_lines

_log = logging.getLogger(__name__)

Sense = Callable[[Pose | None], float | None]
"""Returns the raw pressure now, hPa, None if there is none yet."""


def stream(params: Params, name: str) -> random.Random:
    """Return a separate stream of random numbers, the same in every run with the same seed."""
    return random.Random(f"{params.dynamics.seed} pressure {name}")


def device(named: str, root: Path = iio.DEVICES) -> Path:
    """Return the sensor's folder: the named one, else the first under the root with pressure."""
    if named:
        return Path(named)
    for folder in iio.devices(root):
        if has_pressure(partial(iio.read, folder)):
            return folder
    raise QuadctlError(
        f"no device under {root} measures pressure",
        "plug in a barometer, load its driver, or set pressure.iio to its folder",
    )


def switched_on(params: Params) -> Sense:
    """Return the sensor that the parameters name; raise QuadctlError if a real one is missing."""
    if params.pressure.source == "iio":
        folder = device(params.pressure.iio)
        read = partial(iio.read, folder)
        # Read once before the node is ready, so that a launch without its sensor fails.
        _log.info("%s reads %.4f hPa", folder, hectopascals(str(folder), read))
        return lambda _pose: hectopascals(str(folder), read)
    lab = random.Random(params.dynamics.seed)
    sensor = Simulated(params.pressure, lab, partial(stream, params))
    return lambda pose: (
        None if pose is None else sensor.read(pose.boot, pose.stamp, pose.position.z)
    )


class Output:
    """Published readings of the process, and the service that calibrates them."""

    def __init__(self, node: Node, params: Params, clock: Callable[[], float]) -> None:
        """Switch the sensor on, or raise QuadctlError if missing; `clock` is the time of `read`."""
        self._params, self._log, self._clock = params, node.log, clock
        self._barometer, self._logged = Barometer(params.pressure), "none"
        self.begin()
        self._readings = node.publisher(PRESSURE, lambda: params.pressure.rate, together=True)
        self._begun = time.monotonic()
        node.serve(CALIBRATE, self._calibrate, inline=True)

    @property
    def is_awaited(self) -> bool:
        """Return whether each reading matters at its time: somebody subscribes, or the sensor is real."""
        return self._readings.has_subscribers or self._params.pressure.source == "iio"

    def begin(self) -> None:
        """Restart all that is random, and forget all readings; the baseline stays."""
        self._sense = switched_on(self._params)
        self._faults = SensorFaults(self._params.pressure.fault, stream(self._params, "faults"))
        self._barometer.forget()

    def log_fault(self) -> None:
        """Log that a fault was injected or removed."""
        kind = self._params.pressure.fault.kind
        if kind != self._logged:
            self._logged = kind
            self._log.warning("fault: %s", self._logged)

    def read(self, now: float, pose: Pose | None, *, publishes: bool = True) -> None:
        """Take a reading and publish it. `pose` is the newest; `now` the clock's time, s."""
        raw = self._sense(pose)
        if raw is None:
            return
        # A real sensor also works without a simulation, and then counts its own time.
        stamp = now - self._begun if pose is None else pose.stamp
        given = self._faults.through(stamp, raw)
        if given is not None:
            reading = self._barometer.take(now, stamp, given)
            if publishes:
                self._readings.put(reading)

    def _calibrate(self, request: CalibrateRequest) -> CalibrateResponse:
        try:
            baseline = self._barometer.calibrate(self._clock(), zero=request.zero)
        except NoSample:
            raise NotReady(
                "the barometer had no reading in the last second",
                "is dynamics up? `quadctl status`; is a fault set? `quadctl param get pressure`",
            ) from None
        self._log.info("baseline: %.4f hPa", baseline)
        return CalibrateResponse(baseline)


_DEPTH = 100_000
"""Poses in the queue: in lock-step no process waits for the sensor, and it must lose none."""
_CATCH_UP = 1.0
"""Ticks a second while nobody subscribes."""
_NONE = -1, 0.0
"""Count of the readings' periods before the first one, and the rate (Hz) that it was by."""


class Rhythm:
    """Timing of the readings: in real time at their own rate, in lock-step by the poses'.

    In real time, while nobody subscribes, the readings are taken once a second and before each call, from
    the poses that came meanwhile: of many vehicles, each wake costs more than a second's readings.
    """

    def __init__(self, node: Node, params: Params) -> None:
        self._node, self._params = node, params
        self._lockstep = params.dynamics.in_lockstep
        self._output = Output(node, params, self._now)
        self._boot, self._counted = "", _NONE
        self._pose: Pose | None = None
        self._is_ours, self._by_poses = True, True
        self._topic = self._needed()
        self._poses = self._listen()
        node.on_params = self._on_params
        self._output.log_fault()

    def run(self) -> None:
        """Take readings until stopped."""
        there = self._node.wait_for(lambda: self._pose is not None, FIRST_POSE)
        # A vehicle that is not ours may publish no others than the fast ones.
        self._is_ours = there or self._node.expects(POSE_SLOW)
        self._node.every(self._tick_rate, self._tick)

    def _tick_rate(self) -> float:
        rate = self._params.pressure.rate
        return rate if self._output.is_awaited else min(rate, _CATCH_UP)

    def _tick(self, now: float) -> None:
        self._change_topic()
        # Changed here alone: the poses up to this tick, handled just before, were not read by ticks.
        self._by_poses = self._lockstep or not self._output.is_awaited
        if not self._by_poses:
            self._output.read(now, self._pose)

    def _on_params(self) -> None:
        self._output.log_fault()
        self._change_topic()

    def _needed(self) -> Topic[Any]:
        """Return the topic with the fewest messages that has a pose for each reading."""
        if not self._is_ours:
            return POSE
        if self._lockstep:
            # Not the slow poses: a changed rate would change the topic, and lose poses meanwhile.
            return POSES
        return POSE if POSE_SLOW.hz % self._params.pressure.rate else POSE_SLOW

    def _change_topic(self) -> None:
        if (needed := self._needed()) is not self._topic:
            self._node.unlisten(self._poses)
            self._topic = needed
            self._poses = self._listen()

    def _listen(self) -> Subscription[Any]:
        return self._node.listen(
            self._topic, self._on_poses, _DEPTH, wakes=self._lockstep, skips=True
        )

    def _now(self) -> float:
        """Return the time (s) of the last reading's clock."""
        return self._pose.stamp if self._lockstep and self._pose else time.monotonic()

    def _on_poses(self, message: Pose | Poses) -> None:
        for pose in message.poses if isinstance(message, Poses) else (message,):
            self._on_pose(pose)

    def _read_by(self, pose: Pose) -> None:
        """Take the readings that are due by a pose; at rest, one pose may stand for many."""
        before, rate = self._counted, self._params.pressure.rate
        self._counted = now, _ = period(pose.stamp, rate), rate
        if now == before[0]:
            return
        clock = pose.stamp if self._lockstep else self._poses.received
        is_later = not self._lockstep and before[1] == rate and before[0] >= 0
        missed = min(now - before[0] - 1, int(2 * rate / _CATCH_UP)) if is_later else 0
        for behind in range(missed, -1, -1):
            ago = behind / rate
            then = replace(pose, stamp=pose.stamp - ago) if ago else pose
            # In real time nobody subscribes, or somebody does since: then this one is too late.
            self._output.read(clock - ago, then, publishes=self._lockstep)

    def _on_pose(self, pose: Pose) -> None:
        self._pose = pose
        if pose.boot != self._boot:
            self._boot, self._counted = pose.boot, _NONE
            self._node.advance_sim_time(pose.boot, 0.0)
            if self._lockstep:
                # Equal flights give equal readings.
                self._output.begin()
        if self._by_poses:
            self._read_by(pose)
        self._node.advance_sim_time(pose.boot, pose.stamp)


def run(node: Node, params: Params) -> None:
    """Publish readings at the vehicle's height from the first pose on, or of a real sensor."""
    for line in launch_lines(
        params.pressure, node.reference_params and node.reference_params.pressure
    ):
        node.log.info(line)
    if node.restarted:
        node.log.warning("restarted: the baseline is 0 again")
    Rhythm(node, params).run()


if __name__ == "__main__":
    start("pressure", run, keeps_time=True)
