"""The faults by name, each with the parameter that causes it. Pure."""

from collections.abc import Mapping
from typing import Any, NamedTuple


class Fault(NamedTuple):
    """What it does, whose parameter makes it, with which value, and with which it is out."""

    name: str
    about: str
    node: str
    parameter: str
    value: Any
    sound: Any


def _barometer(kind: str, about: str) -> Fault:
    return Fault(f"barometer-{kind}", about, "pressure", "pressure.fault.kind", kind, "none")


def _pose(kind: str, about: str) -> Fault:
    return Fault(f"pose-{kind}", about, "dynamics", "dynamics.fault.pose", kind, "none")


FAULTS = (
    _barometer("stuck", "the barometer shows its last value again and again"),
    _barometer("off", "the barometer gives no readings"),
    _barometer("glitch", "the barometer has spikes now and then"),
    _barometer("delay", "the barometer shows old values"),
    _pose("frozen", "the pose told is the last one again and again"),
    _pose("delayed", "the pose told is an old one"),
    _pose("jump", "the pose told is off the true place"),
    Fault(
        "motor-weak",
        "the motors give less thrust than the controller knows of",
        "dynamics",
        "dynamics.fault.motors",
        0.9,
        1.0,
    ),
    Fault("gust", "gusts of wind", "dynamics", "dynamics.wind.gust", 2.0, 0.0),
)

OF_PROCESSES = {
    "killed": ("KILL", "a process is killed; the supervisor restarts it"),
    "frozen": ("STOP", "a process is frozen; the supervisor restarts it after 2 s"),
}
"""Put in as `safety-killed`: the signal, and what comes of it."""
BUS_CUT = "bus-cut"
"""Nobody hears anybody: the hub is frozen."""


def active(values: Mapping[str, Any]) -> list[str]:
    """The faults that parameters, by dotted name, say are in; a number counts that is not sound."""
    return [
        fault.name
        for fault in FAULTS
        if (there := values.get(fault.parameter, fault.sound)) != fault.sound
        and (isinstance(there, float) or there == fault.value)
    ]
