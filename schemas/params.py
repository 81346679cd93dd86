"""Every parameter: its default, bounds, unit and meaning, written once.

`quadctl init`, `param describe`, the checks at launch and `param set` all read these classes.
Values that a node reads at its next step change at once with `param set`.
"""

from typing import Annotated

from msgspec import Meta, Struct, field

from schemas.barometer import PressureParams
from schemas.faults import FlightFaultParams
from schemas.hub import HubParams
from schemas.units import Metres
from schemas.vehicle import ControlParams, VehicleParams
from schemas.wind import WindParams

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
