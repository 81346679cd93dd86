"""Faults by name, each with the parameter that causes it. Pure."""

from collections.abc import Mapping
from typing import Any, NamedTuple


class Fault(NamedTuple):
    """Fault: its node and parameter, the value that causes it, and the value without it.

    `size` is the parameter of its size, empty for a fault without one, and `parameter` itself where
    a number is the fault.
    """

    name: str
    about: str
    node: str
    parameter: str
    value: Any
    sound: Any
    size: str = ""

    def values(self, size: float | None) -> dict[str, Any]:
        """Return the parameters that cause it, with a size if one is given."""
        return {self.parameter: self.value} | ({} if size is None else {self.size: size})

    def cleared(self, launched: Mapping[str, Any]) -> dict[str, Any]:
        """Return the parameters without it; the size is that of the launch again."""
        return self.former_size(launched) | {self.parameter: self.sound}

    def former_size(self, launched: Mapping[str, Any]) -> dict[str, Any]:
        """Return the size of the launch, by its parameter; nothing for a fault without one."""
        return {name: launched[name] for name in [self.size] if name in launched}


def _barometer(kind: str, about: str, size: str = "") -> Fault:
    return Fault(f"barometer-{kind}", about, "pressure", "pressure.fault.kind", kind, "none", size)


def _pose(kind: str, about: str, size: str = "") -> Fault:
    return Fault(f"pose-{kind}", about, "dynamics", "dynamics.fault.pose", kind, "none", size)


FAULTS = (
    _barometer("stuck", "the barometer shows its last value again and again"),
    _barometer("off", "the barometer gives no readings"),
    _barometer(
        "glitch", "the barometer has spikes now and then, of SIZE hPa", "pressure.fault.magnitude"
    ),
    _barometer("delay", "the barometer shows values of SIZE s ago", "pressure.fault.delay"),
    _pose("frozen", "the reported pose is the last one again and again"),
    _pose("delayed", "the reported pose is that of SIZE s ago", "dynamics.fault.delay"),
    _pose("jump", "the reported pose is SIZE m off the true place, in x", "dynamics.fault.jump"),
    Fault(
        "motor-weak",
        "the motors give SIZE of the thrust, 0.5 to 1, else 0.9, unknown to the controller",
        "dynamics",
        "dynamics.fault.motors",
        0.9,
        1.0,
        "dynamics.fault.motors",
    ),
    Fault(
        "gust",
        "gusts of wind, of SIZE m/s (RMS), else 2",
        "dynamics",
        "dynamics.wind.gust",
        2.0,
        0.0,
        "dynamics.wind.gust",
    ),
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
