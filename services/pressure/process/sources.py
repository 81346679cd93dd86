"""Where raw readings come from: the simulated sensor, or a real one."""

import logging
import random
from collections.abc import Callable
from functools import partial
from pathlib import Path

from schemas.messages import Pose
from schemas.params import Params
from services.pressure.channel import has_pressure, hectopascals
from services.pressure.simulated import Simulated
from services.runtime import iio
from services.runtime.errors import QuadctlError

_log = logging.getLogger(__name__)

Sense = Callable[[Pose | None], float | None]
"""The raw pressure now, hPa, None where there is none yet."""


def switched_on(params: Params) -> Sense:
    """The sensor as the file names it; QuadctlError where a real one is not there."""
    return _real(params) if params.pressure.source == "iio" else _simulated(params)


def stream(params: Params, name: str) -> random.Random:
    """A stream of random numbers of its own, the same in every run with the same seed."""
    return random.Random(f"{params.dynamics.seed} pressure {name}")


def device(named: str, root: Path = iio.DEVICES) -> Path:
    """The sensor's folder: the one named, else the first under the root that has pressure."""
    if named:
        return Path(named)
    for folder in iio.devices(root):
        if has_pressure(partial(iio.read, folder)):
            return folder
    raise QuadctlError(
        f"no device under {root} has pressure",
        "plug a barometer in, load its driver, or name its folder in pressure.iio",
    )


def _simulated(params: Params) -> Sense:
    lab = random.Random(params.dynamics.seed)
    sensor = Simulated(params.pressure, lab, partial(stream, params))
    return lambda pose: (
        None if pose is None else sensor.read(pose.boot, pose.stamp, pose.position.z)
    )


def _real(params: Params) -> Sense:
    folder = device(params.pressure.iio)
    read = partial(iio.read, folder)
    # Read once before the node is ready, so that a launch without its sensor fails.
    _log.info("%s shows %.4f hPa", folder, hectopascals(str(folder), read))
    return lambda _pose: hectopascals(str(folder), read)
