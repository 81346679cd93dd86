"""Parameters of safety, dynamics, hub and supervisor: the classes behind the TOML file.

`quadctl init`, `param describe`, the checks at launch and `param set` all read these classes.
`param set` changes values at once if a node reads them at its next step.
"""

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Annotated, Any, Literal, TypeVar

from msgspec import Meta, Struct, field, msgpack

from quadctl.schemas.barometer import PressureParams
from quadctl.schemas.protocols import LOCAL, PORTS, SECURE
from quadctl.schemas.units import Metres, described
from quadctl.schemas.vehicle import ControlParams, VehicleParams
from quadctl.schemas.zones import ZoneParams, check_zones


class FlightFaultParams(Struct, forbid_unknown_fields=True):
    """Faults of the vehicle, and of its published pose."""

    pose: Annotated[
        Literal["none", "frozen", "delayed", "jump"],
        described("frozen: the last pose repeated; delayed: old poses; jump: off the true place"),
    ] = "none"
    delay: Annotated[float, described("age of a delayed pose", "s", gt=0, le=10)] = 0.5
    jump: Annotated[float, described("error of a jump, in x", "m", ge=-1000, le=1000)] = 3.0
    motors: Annotated[
        float,
        described("share of the motors' thrust left, unknown to the controller", ge=0.5, le=1),
    ] = 1.0


class HubParams(Struct, forbid_unknown_fields=True):
    """The Zenoh router that all other processes connect to."""

    transport: Annotated[
        Literal["auto", "unix", "tcp"],
        described(
            "unix: a socket in the realm's folder; tcp: a loopback port with a password;"
            " auto: unix if available"
        ),
    ] = "auto"
    listen: Annotated[
        list[str], described("further Zenoh endpoints to listen on, such as tcp/127.0.0.1:7447")
    ] = field(default_factory=list)
    connect: Annotated[
        list[str], described("other hubs to join, by their endpoints, such as tls/field.local:7447")
    ] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Raise ValueError for an endpoint that no Zenoh router can use."""
        if self.transport == "tcp" and any(
            endpoint.partition("/")[0] in SECURE for endpoint in (*self.listen, *self.connect)
        ):
            raise ValueError("tls and quic use certificates, no password: they need transport unix")
        for name, endpoints in (("listen", self.listen), ("connect", self.connect)):
            for endpoint in endpoints:
                protocol, _, address = endpoint.partition("/")
                if address and (protocol in LOCAL or (protocol in PORTS and ":" in address)):
                    continue
                raise ValueError(
                    f"{name}: '{endpoint}' is not a Zenoh endpoint, protocol/address such as"
                    f" tcp/127.0.0.1:7447; the protocols are {', '.join((*PORTS, *LOCAL))}"
                )


WindSpeed = Annotated[float, Meta(ge=-30, le=30)]


class MeanWindParams(Struct, forbid_unknown_fields=True):
    """Velocity of the steady wind, ENU, m/s."""

    x: WindSpeed = 0.0
    y: WindSpeed = 0.0
    z: WindSpeed = 0.0


class WindParams(Struct, forbid_unknown_fields=True):
    """Wind and gusts, the same at each boot with the same `dynamics.seed`."""

    mean: Annotated[MeanWindParams, described("velocity of the steady wind", "m/s")] = field(
        default_factory=MeanWindParams
    )
    gust: Annotated[float, described("RMS of gusts on each axis", "m/s", ge=0, le=20)] = 0.0
    gust_length: Annotated[float, described("length scale of gusts", "m", ge=0.1, le=1000)] = 10.0


CagePoint = Annotated[float, Meta(ge=0.2, le=10_000)]
"""Bound of the cage, m: at least 0.2, because a smaller cage would not hold the vehicle."""


class CageParams(Struct, forbid_unknown_fields=True):
    """The virtual cage: x in [-x, x], y in [-y, y], z in [0, z]."""

    x: CagePoint = 5.0
    y: CagePoint = 5.0
    z: CagePoint = 5.0


class SeparationParams(Struct, forbid_unknown_fields=True):
    """Distance between the vehicles of a run: an ellipsoid about each, the cage on or off."""

    radius: Annotated[
        float,
        described(
            "half of the horizontal distance that two vehicles keep; 0: off", "m", ge=0, le=100
        ),
    ] = 0.3
    height: Annotated[
        float,
        described(
            "vertical distance that two vehicles keep, more for the downwash", "m", gt=0, le=100
        ),
    ] = 0.9


class SafetyParams(Struct, forbid_unknown_fields=True):
    """The safety automaton."""

    acceptance_range: Annotated[
        float, described("a goal nearer than this is reached", "m", gt=0, le=100)
    ] = 0.5
    cage_on: Annotated[
        bool, described("the cage is on at launch; use `quadctl cage on` and `off` later")
    ] = True
    virtual_cage: Annotated[
        CageParams, described("x in [-x, x], y in [-y, y], z in [0, z]", "m")
    ] = field(default_factory=CageParams)
    takeoff: Annotated[
        float,
        described("height of the first goal above the start; 0: no take-off", "m", ge=0, le=10_000),
    ] = 1.0
    pose_timeout: Annotated[
        float,
        described("age of a pose that pauses the flight: the vehicle brakes", "s", ge=0.05, le=10),
    ] = 0.2
    max_speed: Annotated[
        float,
        described("faster motion from pose to pose stops the flight", "m/s", gt=0, le=1000),
    ] = 10.0
    max_deceleration: Annotated[
        float,
        described(
            "a flight too fast to stop in the cage at this rate is stopped", "m/s^2", gt=0, le=1000
        ),
    ] = 10.0
    reaction: Annotated[
        float,
        described(
            "time until a vehicle brakes, counted in its way to a stop: of an autopilot that is"
            " not ours",
            "s",
            ge=0,
            le=5,
        ),
    ] = 0.0
    max_acceleration: Annotated[
        float,
        described(
            "most acceleration in that time, of an autopilot that is not ours; 0: that of the limits"
            " of dynamics",
            "m/s^2",
            ge=0,
            le=1000,
        ),
    ] = 0.0
    min_deceleration: Annotated[
        float,
        described(
            "least deceleration after it, of an autopilot that is not ours; 0: by the limits of"
            " dynamics",
            "m/s^2",
            ge=0,
            le=1000,
        ),
    ] = 0.0
    margin: Annotated[
        float,
        described("tolerance of max_speed and max_deceleration; wind adds to it", "m", ge=0, le=10),
    ] = 0.01
    warn_within: Annotated[
        float, described("distance to a wall that the state warns of", "m", ge=0, le=10_000)
    ] = 0.5
    zones: Annotated[
        list[ZoneParams],
        described("zones that the vehicle must not enter or must not leave, with the cage on"),
    ] = field(default_factory=list)
    separation: Annotated[
        SeparationParams, described("distance that the vehicles of a run keep from each other")
    ] = field(default_factory=SeparationParams)

    def __post_init__(self) -> None:
        """Raise ValueError for too many zones or two of one name."""
        check_zones(self.zones)


class StartParams(Struct, forbid_unknown_fields=True):
    """Place of the vehicle at boot, ENU."""

    x: Metres = 0.0
    y: Metres = 0.0
    z: Annotated[float, Meta(ge=0, le=10_000)] = 0.0


class DynamicsParams(Struct, forbid_unknown_fields=True):
    """The simulated vehicle."""

    start: Annotated[
        StartParams, described("place of the vehicle at boot, from the next reset on", "m")
    ] = field(default_factory=StartParams)
    rate: Annotated[
        float,
        described("poses per second; 1000 / rate must be whole", "Hz", ge=20, le=1000),
    ] = 100.0
    speed: Annotated[
        float, described("simulated seconds per second; 0 is as fast as possible", ge=0, le=1000)
    ] = 1.0
    lockstep: Annotated[
        bool,
        described(
            "the simulated clock waits for safety also at speed 1, as it does at any other: flights"
            " are the same under any load, and calls may be scheduled"
        ),
    ] = False
    seed: Annotated[
        int, described("seed of all random numbers, such as gusts and sensor noise", ge=0, lt=2**31)
    ] = 0
    setpoint_timeout: Annotated[
        float,
        described("age of a setpoint at which the vehicle brakes to a hover", "s", ge=0.05, le=10),
    ] = 0.15
    grace: Annotated[
        float,
        described(
            "a flight resumes after poses or setpoints were missing for up to this long;"
            " a longer silence ends it",
            "s",
            ge=0,
            le=10,
        ),
    ] = 1.0
    unproven: Annotated[
        bool,
        described(
            "body and gains may be far from those that were flown: no promise holds for them"
        ),
    ] = False
    wind: WindParams = field(default_factory=WindParams)
    vehicle: VehicleParams = field(default_factory=VehicleParams)
    control: ControlParams = field(default_factory=ControlParams)
    fault: FlightFaultParams = field(default_factory=FlightFaultParams)

    def __post_init__(self) -> None:
        """Raise ValueError if poses miss the 1 ms steps, or a fault would stop the clock."""
        if (1000 / self.rate) % 1:
            raise ValueError(f"rate {self.rate} Hz: 1000 / rate must be a whole number")
        if self.in_lockstep and self.fault.pose in {"frozen", "delayed"}:
            raise ValueError(
                f"fault.pose {self.fault.pose}: in lock-step the clock would wait for the pose for"
                " ever; it needs speed 1 and lockstep false"
            )

    @property
    def in_lockstep(self) -> bool:
        """Return whether the simulated clock waits for safety, for as long as the run lasts."""
        return self.lockstep or self.speed != 1


def in_lockstep(values: Mapping[str, Any]) -> bool:
    """Return whether the parameters of a run, by dotted name, put it in lock-step."""
    return values.get("dynamics.speed", 1.0) != 1 or bool(values.get("dynamics.lockstep"))


class SuperviseParams(Struct, forbid_unknown_fields=True):
    """Supervision of the processes by `quadctl up`."""

    answer_timeout: Annotated[
        float, described("a process silent for longer is restarted", "s", ge=0.5, le=60)
    ] = 2.0


class Params(Struct, forbid_unknown_fields=True):
    """Whole parameter file. `processes` are commands in place of built-in nodes, or additional."""

    pressure: PressureParams = field(default_factory=PressureParams)
    safety: SafetyParams = field(default_factory=SafetyParams)
    dynamics: DynamicsParams = field(default_factory=DynamicsParams)
    hub: HubParams = field(default_factory=HubParams)
    supervise: SuperviseParams = field(default_factory=SuperviseParams)
    processes: Annotated[
        dict[str, str | list[str]],
        described("commands to run in place of built-in nodes, or in addition"),
    ] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise ValueError if values of different tables do not fit together."""
        if self.pressure.source == "iio" and self.dynamics.in_lockstep:
            raise ValueError(
                "pressure.source iio reads a real sensor, in real time: it needs dynamics.speed 1"
                " and dynamics.lockstep false"
            )


FIXED_AT_LAUNCH = frozenset(
    (
        "safety.cage_on", "pressure.source", "pressure.iio", "dynamics.speed", "dynamics.lockstep",
        "dynamics.seed", "dynamics.grace", "dynamics.unproven", "hub.transport", "hub.listen", "hub.connect",
    )
)  # fmt: skip
"""Parameters shared by all processes, or with irreversible effects: `param set` refuses these."""

FROM_STANDSTILL = ("dynamics.vehicle", "dynamics.control")
"""Tables with values that, set in flight, take effect at the vehicle's next standstill."""

LIVE_SWITCHES = {"safety.cage_on": "`quadctl cage on` or `quadctl cage off`"}
"""Commands that change in a running system the value that these parameters set at launch."""

R = TypeVar("R")
_MOST_RESULTS = 100


def by_value(function: Callable[..., R]) -> Callable[..., R]:
    """Return a pure function that computes once for equal values: those of a thousand vehicles are."""
    results: dict[bytes, R] = {}

    @wraps(function)
    def computed(*values: Any) -> R:
        key = msgpack.encode(values)
        try:
            return results[key]
        except KeyError:
            result = function(*values)
        if len(results) >= _MOST_RESULTS:
            results.clear()
        results[key] = result
        return result

    return computed
