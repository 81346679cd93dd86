"""The vehicle's own parameters: body, rotors, controller. Defaults are the lab's simulator's.

The lower bounds keep divisors away from 0 and motions within what 1 ms steps can follow.
"""

from typing import Annotated

from msgspec import Meta, Struct, field


class InertiaParams(Struct, forbid_unknown_fields=True):
    """Principal moments of inertia in the body frame, kg m^2."""

    x: Annotated[float, Meta(ge=1e-6, le=100)] = 0.0049
    y: Annotated[float, Meta(ge=1e-6, le=100)] = 0.0049
    z: Annotated[float, Meta(ge=1e-6, le=100)] = 0.0069


class RotorDragParams(Struct, forbid_unknown_fields=True):
    """A rotor's force against air that moves across its axis, and along it, N/(rad/s)/(m/s)."""

    across: Annotated[float, Meta(ge=0, le=0.001)] = 0.0
    along: Annotated[float, Meta(ge=0, le=0.001)] = 0.0


class VehicleParams(Struct, forbid_unknown_fields=True):
    """Body and rotors of a quadrotor in X configuration."""

    mass: Annotated[float, Meta(ge=0.01, le=1000, description="mass", extra={"unit": "kg"})] = 1.0
    inertia: Annotated[
        InertiaParams, Meta(description="principal moments of inertia", extra={"unit": "kg m^2"})
    ] = field(default_factory=InertiaParams)
    arm: Annotated[
        float,
        Meta(ge=0.01, le=10, description="rotor's distance from the centre", extra={"unit": "m"}),
    ] = 0.08
    thrust_coefficient: Annotated[
        float,
        Meta(
            ge=1e-9, le=0.01, description="thrust per squared speed", extra={"unit": "N/(rad/s)^2"}
        ),
    ] = 1.91e-6
    torque_coefficient: Annotated[
        float,
        Meta(
            ge=1e-10,
            le=1e-4,
            description="drag torque per squared speed",
            extra={"unit": "N m/(rad/s)^2"},
        ),
    ] = 2.6e-7
    max_motor_speed: Annotated[
        float, Meta(ge=100, le=100_000, description="motor speed limit", extra={"unit": "rad/s"})
    ] = 2200.0
    motor_lag: Annotated[
        float,
        Meta(
            ge=0.001, le=10, description="first-order time constant of a motor", extra={"unit": "s"}
        ),
    ] = 0.02
    gravity: Annotated[
        float, Meta(ge=0, le=100, description="gravity", extra={"unit": "m/s^2"})
    ] = 9.81
    drag: Annotated[
        float, Meta(ge=0, le=100, description="force per |v| v", extra={"unit": "N/(m/s)^2"})
    ] = 0.1
    linear_drag: Annotated[
        float, Meta(ge=0, le=10, description="force per v", extra={"unit": "N/(m/s)"})
    ] = 0.0
    rotor_drag: Annotated[
        RotorDragParams,
        Meta(
            description="force per motor speed and airspeed, summed over the rotors",
            extra={"unit": "N/(rad/s)/(m/s)"},
        ),
    ] = field(default_factory=RotorDragParams)


class ControlParams(Struct, forbid_unknown_fields=True):
    """Cascade controller and the limits of the setpoint it follows."""

    position_gain: Annotated[
        float,
        Meta(ge=0.01, le=100, description="position error to velocity", extra={"unit": "1/s"}),
    ] = 1.6
    velocity_gain: Annotated[
        float,
        Meta(ge=0.01, le=100, description="velocity error to acceleration", extra={"unit": "1/s"}),
    ] = 4.0
    attitude_gain: Annotated[
        float,
        Meta(ge=0.01, le=1000, description="attitude error to body rates", extra={"unit": "1/s"}),
    ] = 9.0
    rate_gain: Annotated[
        float,
        Meta(
            ge=0.01,
            le=1000,
            description="body rate error to angular acceleration",
            extra={"unit": "1/s"},
        ),
    ] = 28.0
    max_tilt: Annotated[
        float, Meta(ge=0.05, le=1.4, description="tilt limit", extra={"unit": "rad"})
    ] = 0.7
    max_speed: Annotated[
        float,
        Meta(ge=0.01, le=100, description="speed limit of the setpoint", extra={"unit": "m/s"}),
    ] = 5.0
    max_acceleration: Annotated[
        float,
        Meta(
            ge=0.01,
            le=100,
            description="acceleration limit of the setpoint",
            extra={"unit": "m/s^2"},
        ),
    ] = 5.0
    max_jerk: Annotated[
        float,
        Meta(ge=0.1, le=10_000, description="jerk limit of the setpoint", extra={"unit": "m/s^3"}),
    ] = 40.0
