"""Check that a vehicle can hold its place with its controller in its wind. SI units.

The spare acceleration is in closed form, for the worst direction. The damping is that of the linear
loop from position to thrust: cascaded gains, and the motors' lag plus half a control period.
"""

from math import cos, hypot, sin, sqrt, tan

from quadctl.schemas.params import WindParams
from quadctl.schemas.vehicle import ControlParams, VehicleParams

CONTROL_PERIOD = 0.004
"""Seconds between two motor commands."""
LEAST_DAMPING = 0.1
"""Damping ratio: with less, a loop swings for long, and with 0 for ever."""
_LIFT = 0.9
"""Share of the full thrust that the vertical may take."""
_SINK = 0.8
"""Share of gravity that the vehicle may fall with."""
_GUSTS = 2.0
"""RMS values of the gusts added to the mean wind."""
_CLOSE = 1e-12
"""Relative precision of roots; it takes some ten rounds."""


def why_not(vehicle: VehicleParams, control: ControlParams, wind: WindParams) -> str:
    """Return why these do not fly, or an empty string if they do."""
    damped = damping(vehicle, control)
    if damped < LEAST_DAMPING:
        kind = "unstable" if damped <= 0 else "hardly damped"
        return (
            f"{kind}: the gains and motor_lag {vehicle.motor_lag:g} s give a damping of"
            f" {damped:.2g}, below {LEAST_DAMPING:g}"
        )
    spare, cause = min(_spare(vehicle, control, wind), key=lambda each: each[0])
    return f"it cannot hold itself: {cause}" if spare <= 0 else ""


def _spare(
    vehicle: VehicleParams, control: ControlParams, wind: WindParams
) -> tuple[tuple[float, str], ...]:
    """Return the spare acceleration in every direction while it holds itself, by each cause."""
    g, tilt = vehicle.gravity, control.max_tilt
    full = 4 * vehicle.thrust_coefficient * vehicle.max_motor_speed**2 / vehicle.mass
    hover = sqrt(0.25 * vehicle.mass * g / vehicle.thrust_coefficient)
    speed = hypot(wind.mean.x, wind.mean.y) + _GUSTS * wind.gust
    linear = vehicle.linear_drag + 4 * hover * vehicle.rotor_drag.across
    drag = (vehicle.drag * speed + linear) * speed / vehicle.mass
    held = g * tan(tilt)
    return (
        (_SINK * g, "without gravity it can neither sink nor accelerate sideways"),
        (
            g * sin(tilt) - drag * cos(tilt),
            f"wind of {speed:.3g} m/s pushes by {drag:.3g} m/s^2, max_tilt holds {held:.3g}",
        ),
        (
            _LIFT * full - g,
            f"its motors lift {_LIFT * full:.3g} m/s^2 at most, and gravity pulls {g:g}",
        ),
    )


def damping(vehicle: VehicleParams, control: ControlParams) -> float:
    """Return the least damping of the closed loop's modes: 1 does not swing, 0 and less grows."""
    kp, kv = control.position_gain, control.velocity_gain
    ka, kr = control.attitude_gain, control.rate_gain
    delay = vehicle.motor_lag + 0.5 * CONTROL_PERIOD
    loop = (delay, 1.0, kr, kr * ka, kr * ka * kv, kr * ka * kv * kp)
    return min(-root.real / abs(root) for root in _roots(loop))


def _roots(coefficients: tuple[float, ...]) -> list[complex]:
    """Return a polynomial's roots, the highest power first, by Durand and Kerner's method."""
    first, last, order = coefficients[0], coefficients[-1], len(coefficients) - 1
    scale = (last / first) ** (1 / order)
    monic = [value / (first * scale**power) for power, value in enumerate(coefficients)]
    roots = [(0.4 + 0.9j) ** number for number in range(order)]
    moved = 1.0
    while moved > _CLOSE:
        moved = 0.0
        for number, root in enumerate(roots):
            above, below = 0j, 1 + 0j
            for value in monic:
                above = above * root + value
            for other in roots[:number] + roots[number + 1 :]:
                below *= root - other
            roots[number] = root - above / below
            moved = max(moved, abs(above / below) / abs(root))
    return [scale * root for root in roots]
