"""The way of a raw reading: what is wrong with it, the baseline, the topic."""

import time
from collections.abc import Callable

from schemas.messages import Pose
from schemas.params import Params
from schemas.services import CalibrateRequest, CalibrateResponse
from schemas.topics import CALIBRATE, PRESSURE
from services.pressure.faults import Faults
from services.pressure.process.sources import stream, switched_on
from services.pressure.sensor import Barometer, NoSample
from services.runtime.errors import NotReady
from services.runtime.node import Node


class Output:
    """What the process publishes, and the service that calibrates it."""

    def __init__(self, node: Node, params: Params, clock: Callable[[], float]) -> None:
        """`clock` is the time of `read`, now. QuadctlError where a real sensor is not there."""
        self._params, self._log, self._clock = params, node.log, clock
        self._barometer, self._told = Barometer(params.pressure), "none"
        self.begin()
        self._readings = node.publisher(
            PRESSURE, lambda: params.pressure.rate, waits=params.dynamics.speed != 1
        )
        self._begun = time.monotonic()
        node.on_params = self.tell_fault
        node.serve(CALIBRATE, self._calibrate, at_once=True)

    def begin(self) -> None:
        """Begin anew with all that is random, and with no reading yet; the baseline stays."""
        self._sense = switched_on(self._params)
        self._faults = Faults(self._params.pressure.fault, stream(self._params, "faults"))
        self._barometer.forget()

    def tell_fault(self) -> None:
        """Say in the log that a fault has been put in, or taken out."""
        kind = self._params.pressure.fault.kind
        if kind != self._told:
            self._told = kind
            self._log.warning("fault: %s", self._told)

    def read(self, now: float, pose: Pose | None) -> None:
        """Take a reading and publish it. `pose` is the newest; `now` the clock's time, s."""
        raw = self._sense(pose)
        if raw is None:
            return
        # A real sensor works without a simulation too, and then with a time of its own.
        stamp = now - self._begun if pose is None else pose.stamp
        given = self._faults.through(stamp, raw)
        if given is not None:
            self._readings.put(self._barometer.take(now, stamp, given))

    def _calibrate(self, request: CalibrateRequest) -> CalibrateResponse:
        try:
            baseline = self._barometer.calibrate(self._clock(), zero=request.zero)
        except NoSample:
            raise NotReady(
                "the barometer has had no sample in the last second",
                "is dynamics up? `quadctl status`; is a fault put in? `quadctl param get pressure`",
            ) from None
        self._log.info("baseline: %.4f hPa", baseline)
        return CalibrateResponse(baseline)
