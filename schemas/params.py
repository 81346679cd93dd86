"""The parameter file: safety, dynamics, hub, supervisor.

`quadctl init`, `param describe`, the checks at launch and `param set` all read these classes.
Values that a node reads at its next step change at once with `param set`.
"""

from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from quadctl.schemas.barometer import PressureParams
from quadctl.schemas.units import Metres
from quadctl.schemas.vehicle import ControlParams, VehicleParams

PORTS = ("tcp", "tls", "quic", "udp", "ws")
"""Those on host:port."""
SECURE = ("tls", "quic")
"""Those of them by which both ends show a certificate, and all between is encrypted."""
LOCAL = ("unixsock-stream",)
"""Those on a path."""


class FlightFaultParams(Struct, forbid_unknown_fields=True):
    """What is wrong with the vehicle, and with the pose that is told of it."""

    pose: Annotated[
        Literal["none", "frozen", "delayed", "jump"],
        Meta(
            description="frozen: the last one again and again; delayed: old ones; jump: off the"
            " true place",
            extra={"unit": ""},
        ),
    ] = "none"
    delay: Annotated[
        float,
        Meta(gt=0, le=10, description="how old a delayed pose is", extra={"unit": "s"}),
    ] = 0.5
    jump: Annotated[
        float,
        Meta(ge=-1000, le=1000, description="how far off a pose jumps, in x", extra={"unit": "m"}),
    ] = 3.0
    motors: Annotated[
        float,
        Meta(
            ge=0.5,
            le=1,
            description="share of their thrust that the motors give, unknown to the controller",
            extra={"unit": ""},
        ),
    ] = 1.0


class HubParams(Struct, forbid_unknown_fields=True):
    """The Zenoh router that everything else is a client of."""

    transport: Annotated[
        Literal["auto", "unix", "tcp"],
        Meta(
            description="unix: a socket in the realm's folder; tcp: a loopback port with a password;"
            " auto: unix where there is such a thing",
            extra={"unit": ""},
        ),
    ] = "auto"
    listen: Annotated[
        list[str],
        Meta(
            description="further Zenoh endpoints to listen on, such as tcp/127.0.0.1:7447",
            extra={"unit": ""},
        ),
    ] = field(default_factory=list)
    connect: Annotated[
        list[str],
        Meta(
            description="other hubs to join, by their endpoints, such as tls/field.local:7447",
            extra={"unit": ""},
        ),
    ] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Raises ValueError for what no Zenoh router can listen on, or connect to."""
        if self.transport == "tcp" and any(
            endpoint.partition("/")[0] in SECURE for endpoint in (*self.listen, *self.connect)
        ):
            raise ValueError(
                "tls and quic need transport unix: they have certificates, no password"
            )
        for name, endpoints in (("listen", self.listen), ("connect", self.connect)):
            for endpoint in endpoints:
                _check_endpoint(name, endpoint)


def _check_endpoint(name: str, endpoint: str) -> None:
    protocol, _, address = endpoint.partition("/")
    if not (address and (protocol in LOCAL or (protocol in PORTS and ":" in address))):
        known = ", ".join((*PORTS, *LOCAL))
        raise ValueError(
            f"{name}: '{endpoint}' is no Zenoh endpoint, which is protocol/address such as "
            f"tcp/127.0.0.1:7447; the protocols are {known}"
        )


WindSpeed = Annotated[float, Meta(ge=-30, le=30)]


class MeanWindParams(Struct, forbid_unknown_fields=True):
    """The steady wind: where the air goes, ENU, m/s."""

    x: WindSpeed = 0.0
    y: WindSpeed = 0.0
    z: WindSpeed = 0.0


class WindParams(Struct, forbid_unknown_fields=True):
    """The air, made the same again at each boot by `dynamics.seed`."""

    mean: Annotated[
        MeanWindParams,
        Meta(description="steady wind, the way that the air goes", extra={"unit": "m/s"}),
    ] = field(default_factory=MeanWindParams)
    gust: Annotated[
        float, Meta(ge=0, le=20, description="RMS of gusts on each axis", extra={"unit": "m/s"})
    ] = 0.0
    gust_length: Annotated[
        float, Meta(ge=0.1, le=1000, description="length scale of gusts", extra={"unit": "m"})
    ] = 10.0


CagePoint = Annotated[float, Meta(ge=0.2, le=10_000)]
"""A cage smaller than the vehicle would hold nothing, so 0.2 m is the least."""


class CageParams(Struct, forbid_unknown_fields=True):
    """The virtual cage: x in [-x, x], y in [-y, y], z in [0, z]."""

    x: CagePoint = 5.0
    y: CagePoint = 5.0
    z: CagePoint = 5.0


class SafetyParams(Struct, forbid_unknown_fields=True):
    """The safety automaton."""

    acceptance_range: Annotated[
        float,
        Meta(gt=0, le=100, description="a goal nearer than this is reached", extra={"unit": "m"}),
    ] = 0.5
    cage_on: Annotated[
        bool,
        Meta(
            description="whether the cage is on at launch; `quadctl cage on` and `off` turn it later",
            extra={"unit": ""},
        ),
    ] = True
    virtual_cage: Annotated[
        CageParams,
        Meta(description="x in [-x, x], y in [-y, y], z in [0, z]", extra={"unit": "m"}),
    ] = field(default_factory=CageParams)
    takeoff: Annotated[
        float,
        Meta(
            ge=0,
            le=10_000,
            description="height of the first goal above the start; 0 stays on the ground",
            extra={"unit": "m"},
        ),
    ] = 1.0
    pose_timeout: Annotated[
        float,
        Meta(
            ge=0.05,
            le=10,
            description="a pose older than this pauses the flight: the vehicle brakes",
            extra={"unit": "s"},
        ),
    ] = 0.2
    max_speed: Annotated[
        float,
        Meta(
            gt=0,
            le=1000,
            description="a pose that would take more speed than this to reach stops the flight",
            extra={"unit": "m/s"},
        ),
    ] = 10.0
    max_deceleration: Annotated[
        float,
        Meta(
            gt=0,
            le=1000,
            description="a flight that even so hard a stop would not end in the cage is stopped",
            extra={"unit": "m/s^2"},
        ),
    ] = 10.0
    margin: Annotated[
        float,
        Meta(
            ge=0,
            le=10,
            description="how far the vehicle may be off before these stop it; more in wind",
            extra={"unit": "m"},
        ),
    ] = 0.01


class StartParams(Struct, forbid_unknown_fields=True):
    """Where the vehicle stands at boot, ENU."""

    x: Metres = 0.0
    y: Metres = 0.0
    z: Annotated[float, Meta(ge=0, le=10_000)] = 0.0


class DynamicsParams(Struct, forbid_unknown_fields=True):
    """The simulated vehicle."""

    start: Annotated[
        StartParams,
        Meta(
            description="where the vehicle stands at boot, from the next reset", extra={"unit": "m"}
        ),
    ] = field(default_factory=StartParams)
    rate: Annotated[
        float,
        Meta(
            ge=20,
            le=1000,
            description="poses per second, so that a period is whole milliseconds",
            extra={"unit": "Hz"},
        ),
    ] = 100.0
    speed: Annotated[
        float,
        Meta(
            ge=0,
            le=1000,
            description="simulated seconds per second; 0 is as fast as it goes",
            extra={"unit": ""},
        ),
    ] = 1.0
    seed: Annotated[
        int,
        Meta(
            ge=0,
            lt=2**31,
            description="of all random numbers, the gusts and the sensors' noise among them",
            extra={"unit": ""},
        ),
    ] = 0
    setpoint_timeout: Annotated[
        float,
        Meta(
            ge=0.05,
            le=10,
            description="a setpoint older than this makes the vehicle brake to a hover",
            extra={"unit": "s"},
        ),
    ] = 0.15
    grace: Annotated[
        float,
        Meta(
            ge=0,
            le=10,
            description="a flight goes on by itself after poses or setpoints were missing for up to"
            " this long; after more it is over",
            extra={"unit": "s"},
        ),
    ] = 1.0
    wind: WindParams = field(default_factory=WindParams)
    vehicle: VehicleParams = field(default_factory=VehicleParams)
    control: ControlParams = field(default_factory=ControlParams)
    fault: FlightFaultParams = field(default_factory=FlightFaultParams)

    def __post_init__(self) -> None:
        """Poses fall on steps of the 1 ms integration; raises ValueError where they cannot."""
        if (1000 / self.rate) % 1:
            raise ValueError(f"rate {self.rate} Hz: 1000 / rate must be a whole number")
        if self.speed != 1 and self.fault.pose in {"frozen", "delayed"}:
            raise ValueError(
                f"fault.pose {self.fault.pose}: in lock-step (speed {self.speed:g}) the clock would"
                " wait for the pose for ever; it needs speed 1"
            )


class SuperviseParams(Struct, forbid_unknown_fields=True):
    """How `quadctl up` looks after its processes."""

    answer_timeout: Annotated[
        float,
        Meta(
            ge=0.5,
            le=60,
            description="a process silent for longer is restarted",
            extra={"unit": "s"},
        ),
    ] = 2.0


class Params(Struct, forbid_unknown_fields=True):
    """The whole file. `processes` names commands to run instead of or besides our nodes."""

    pressure: PressureParams = field(default_factory=PressureParams)
    safety: SafetyParams = field(default_factory=SafetyParams)
    dynamics: DynamicsParams = field(default_factory=DynamicsParams)
    hub: HubParams = field(default_factory=HubParams)
    supervise: SuperviseParams = field(default_factory=SuperviseParams)
    processes: Annotated[
        dict[str, str | list[str]],
        Meta(
            description="commands to run in place of a node of ours, or besides them",
            extra={"unit": ""},
        ),
    ] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Rules between tables; raises ValueError where they do not hold."""
        if self.pressure.source == "iio" and self.dynamics.speed != 1:
            raise ValueError(
                "pressure.source iio reads a real sensor, for which time cannot be simulated: it"
                f" needs dynamics.speed 1, not {self.dynamics.speed:g}"
            )


FIXED_AT_LAUNCH = frozenset(
    {
        "safety.cage_on",
        "pressure.source",
        "pressure.iio",
        "dynamics.speed",
        "dynamics.seed",
        "dynamics.setpoint_timeout",
        "dynamics.grace",
        "hub.transport",
        "hub.listen",
        "hub.connect",
    }
)
"""What all processes must agree on, or what cannot be undone: `param set` refuses these."""

FROM_STANDSTILL = ("dynamics.vehicle", "dynamics.control")
"""Tables whose values hold from the vehicle's next standstill when they are set in flight."""

LIVE_SWITCHES = {"safety.cage_on": "`quadctl cage on` or `quadctl cage off`"}
"""Of these, what changes in the running system that of which they say how it is at launch."""
