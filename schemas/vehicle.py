"""Parameters of the vehicle: body, rotors, controller. Defaults are the lab simulator's.

The lower bounds keep divisors above 0 and motions slow enough for steps of 1 ms.
"""

from typing import Annotated

from msgspec import Meta, Struct, field

from quadctl.schemas.units import described


class InertiaParams(Struct, forbid_unknown_fields=True):
    """Principal moments of inertia in the body frame, kg m^2."""

    x: Annotated[float, Meta(ge=1e-6, le=100)] = 0.0049
    y: Annotated[float, Meta(ge=1e-6, le=100)] = 0.0049
    z: Annotated[float, Meta(ge=1e-6, le=100)] = 0.0069


class RotorDragParams(Struct, forbid_unknown_fields=True):
    """Drag of a rotor in air that moves across or along its axis, N/(rad/s)/(m/s)."""

    across: Annotated[float, Meta(ge=0, le=0.001)] = 0.0
    along: Annotated[float, Meta(ge=0, le=0.001)] = 0.0


class VehicleParams(Struct, forbid_unknown_fields=True):
    """Body and rotors of a quadrotor in X configuration."""

    mass: Annotated[float, described("mass", "kg", ge=0.01, le=1000)] = 1.0
    inertia: Annotated[InertiaParams, described("principal moments of inertia", "kg m^2")] = field(
        default_factory=InertiaParams
    )
    arm: Annotated[float, described("rotor's distance from the centre", "m", ge=0.01, le=10)] = 0.08
    thrust_coefficient: Annotated[
        float, described("thrust per squared speed", "N/(rad/s)^2", ge=1e-9, le=0.01)
    ] = 1.91e-6
    torque_coefficient: Annotated[
        float, described("drag torque per squared speed", "N m/(rad/s)^2", ge=1e-10, le=1e-4)
    ] = 2.6e-7
    max_motor_speed: Annotated[
        float, described("motor speed limit", "rad/s", ge=100, le=100_000)
    ] = 2200.0
    motor_lag: Annotated[
        float, described("first-order time constant of a motor", "s", ge=0.001, le=10)
    ] = 0.02
    gravity: Annotated[float, described("gravity", "m/s^2", ge=0, le=100)] = 9.81
    drag: Annotated[float, described("force per |v| v", "N/(m/s)^2", ge=0, le=100)] = 0.1
    linear_drag: Annotated[float, described("force per v", "N/(m/s)", ge=0, le=10)] = 0.0
    rotor_drag: Annotated[
        RotorDragParams,
        described("force per motor speed and airspeed, summed over the rotors", "N/(rad/s)/(m/s)"),
    ] = field(default_factory=RotorDragParams)


class ControlParams(Struct, forbid_unknown_fields=True):
    """Cascade controller, and the limits of its setpoint."""

    position_gain: Annotated[
        float, described("position error to velocity", "1/s", ge=0.01, le=100)
    ] = 1.6
    velocity_gain: Annotated[
        float, described("velocity error to acceleration", "1/s", ge=0.01, le=100)
    ] = 4.0
    attitude_gain: Annotated[
        float, described("attitude error to body rates", "1/s", ge=0.01, le=1000)
    ] = 9.0
    rate_gain: Annotated[
        float, described("body rate error to angular acceleration", "1/s", ge=0.01, le=1000)
    ] = 28.0
    max_tilt: Annotated[float, described("tilt limit", "rad", ge=0.05, le=1.4)] = 0.7
    max_speed: Annotated[float, described("speed limit of the setpoint", "m/s", ge=0.1, le=100)] = (
        5.0
    )
    max_acceleration: Annotated[
        float, described("acceleration limit of the setpoint", "m/s^2", ge=0.2, le=100)
    ] = 5.0
    max_jerk: Annotated[
        float, described("jerk limit of the setpoint", "m/s^3", ge=0.1, le=10_000)
    ] = 40.0
