"""Faults by name, each with the parameter that causes it. Pure."""

from collections.abc import Mapping
from typing import Any, NamedTuple


class Fault(NamedTuple):
    """Fault: its node and parameter, the value that causes it, and the value without it."""

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
    _pose("frozen", "the reported pose is the last one again and again"),
    _pose("delayed", "the reported pose is an old one"),
    _pose("jump", "the reported pose is off the true place"),
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
"""Faults of a process, by name as in `safety-killed`: the signal and its effect."""
BUS_CUT = "bus-cut"
"""Fault in which no node receives any message: the hub is frozen."""


def active(values: Mapping[str, Any]) -> list[str]:
    """Return the faults in parameters by dotted name; any number counts unless it is sound."""
    return [
        fault.name
        for fault in FAULTS
        if (value := values.get(fault.parameter, fault.sound)) != fault.sound
        and (isinstance(value, float) or value == fault.value)
    ]
