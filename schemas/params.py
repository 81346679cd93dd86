"""Parameters of safety, dynamics, hub and supervisor: the classes behind the TOML file.

`quadctl init`, `param describe`, the checks at launch and `param set` all read these classes.
Values that a node reads at its next step change at once with `param set`.
"""

from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from quadctl.schemas.barometer import PressureParams
from quadctl.schemas.units import Metres, described
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
        described(
            "frozen: the last one again and again; delayed: old ones; jump: off the true place"
        ),
    ] = "none"
    delay: Annotated[float, described("how old a delayed pose is", "s", gt=0, le=10)] = 0.5
    jump: Annotated[
        float,
        described("how far off a pose jumps, in x", "m", ge=-1000, le=1000),
    ] = 3.0
    motors: Annotated[
        float,
        described(
            "share of their thrust that the motors give, unknown to the controller", ge=0.5, le=1
        ),
    ] = 1.0


class HubParams(Struct, forbid_unknown_fields=True):
    """The Zenoh router that everything else is a client of."""

    transport: Annotated[
        Literal["auto", "unix", "tcp"],
        described(
            "unix: a socket in the realm's folder; tcp: a loopback port with a password;"
            " auto: unix where there is such a thing"
        ),
    ] = "auto"
    listen: Annotated[
        list[str], described("further Zenoh endpoints to listen on, such as tcp/127.0.0.1:7447")
    ] = field(default_factory=list)
    connect: Annotated[
        list[str], described("other hubs to join, by their endpoints, such as tls/field.local:7447")
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

    mean: Annotated[MeanWindParams, described("steady wind, the way that the air goes", "m/s")] = (
        field(default_factory=MeanWindParams)
    )
    gust: Annotated[float, described("RMS of gusts on each axis", "m/s", ge=0, le=20)] = 0.0
    gust_length: Annotated[float, described("length scale of gusts", "m", ge=0.1, le=1000)] = 10.0


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
        float, described("a goal nearer than this is reached", "m", gt=0, le=100)
    ] = 0.5
    cage_on: Annotated[
        bool,
        described("whether the cage is on at launch; `quadctl cage on` and `off` turn it later"),
    ] = True
    virtual_cage: Annotated[
        CageParams, described("x in [-x, x], y in [-y, y], z in [0, z]", "m")
    ] = field(default_factory=CageParams)
    takeoff: Annotated[
        float,
        described(
            "height of the first goal above the start; 0 stays on the ground", "m", ge=0, le=10_000
        ),
    ] = 1.0
    pose_timeout: Annotated[
        float,
        described(
            "a pose older than this pauses the flight: the vehicle brakes", "s", ge=0.05, le=10
        ),
    ] = 0.2
    max_speed: Annotated[
        float,
        described(
            "a pose that would take more speed than this to reach stops the flight",
            "m/s",
            gt=0,
            le=1000,
        ),
    ] = 10.0
    max_deceleration: Annotated[
        float,
        described(
            "a flight that even so hard a stop would not end in the cage is stopped",
            "m/s^2",
            gt=0,
            le=1000,
        ),
    ] = 10.0
    margin: Annotated[
        float,
        described(
            "how far the vehicle may be off before these stop it; more in wind", "m", ge=0, le=10
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
        StartParams, described("where the vehicle stands at boot, from the next reset", "m")
    ] = field(default_factory=StartParams)
    rate: Annotated[
        float,
        described("poses per second, so that a period is whole milliseconds", "Hz", ge=20, le=1000),
    ] = 100.0
    speed: Annotated[
        float, described("simulated seconds per second; 0 is as fast as it goes", ge=0, le=1000)
    ] = 1.0
    seed: Annotated[
        int,
        described(
            "of all random numbers, the gusts and the sensors' noise among them", ge=0, lt=2**31
        ),
    ] = 0
    setpoint_timeout: Annotated[
        float,
        described(
            "a setpoint older than this makes the vehicle brake to a hover", "s", ge=0.05, le=10
        ),
    ] = 0.15
    grace: Annotated[
        float,
        described(
            "a flight goes on by itself after poses or setpoints were missing for up to"
            " this long; after more it is over",
            "s",
            ge=0,
            le=10,
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
        float, described("a process silent for longer is restarted", "s", ge=0.5, le=60)
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
        described("commands to run in place of a node of ours, or besides them"),
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
