"""Envelope of a vehicle: whether it can hold its place in its wind, and the limits that it can fly.

The spare acceleration is in closed form, for the worst direction. The damping is that of the linear
loop from position to thrust: cascaded gains, and the motors' lag plus half a control period. The
torque is what roll and pitch have in hover before the mixer adds thrust to make room for them.
SI units.

Not covered: weak motors as a fault.
"""

from collections.abc import Callable
from functools import wraps
from math import cos, hypot, inf, pi, sin, sqrt, tan
from typing import NamedTuple, ParamSpec, TypeVar

import msgspec

from quadctl.schemas.params import WindParams
from quadctl.schemas.vehicle import ControlParams, VehicleParams

CONTROL_PERIOD = 0.004
"""Seconds between two motor commands."""
_LEAST_LAG = 0.05
"""Shortest lag of the setpoint, s: with 0.03, short diagonal climbs, and goals replaced back and
forth in a descent, need torques beyond the thrust: a campaign found one flight in 200 up to 6 cm
off."""
_SWINGS, _SLOWER = 0.4, 1.5
"""Damping ratio below which the setpoint's lag is longer than the motors' delay, and how many times:
otherwise a climb that turns to the side swings; a search found flights up to 2 cm off."""
LEAST_DAMPING = 0.2
"""Damping ratio: with less, a loop swings for long, and with 0 for ever."""
_STIFF = 2.0
"""Least product of the gains (1/s^2) that lead from velocity to turning; a slow turn leaves an error
in the speed, and with less it goes on for centimetres. Found by trying thousands of bodies."""
_BRISK = 1.0
"""Least velocity_gain, 1/s: with less, a small error in the speed, e.g. of a new gravity, goes on for
long. With 0.4, a search in a cage of half a metre found 13 mm."""
_FIRM = 0.2
"""Least rate, 1/s, at which an error of the place goes: at 0.1 and less, those of several turns in
the air added up to 36 mm."""
_LIFT = 0.9
"""Share of the full thrust that the vertical may take."""
_SINK = 0.8
"""Share of gravity that the vehicle may fall with."""
_GUSTS, _STORM = 2.0, 4.0
"""RMS values of the gusts added to the mean wind: to fly in it, and to hold one's place for hours."""
_ROUNDED = 1.1
"""Factor on sums of measured moments of inertia, against their errors."""
_FLOWN = 0.9
"""Share of the spare acceleration that the setpoint may ask for; the rest corrects errors."""
_AT_SPEED = 0.5
"""Least share of the highest acceleration that is left to speed up at the highest speed."""
_BEYOND = 0.1
"""Least share of the highest acceleration that is left at the highest speed and what the end of an
acceleration adds: goals replaced back and forth lead there, and what only just holds it drifts on."""
_HELD = 3.0
"""How hard the air may hold the vehicle, in velocity gains: an error of the place lasts as many times
longer. With 11, those of several turns added up to 24 mm."""
_ASKED = 0.58
"""Share of gravity that the setpoint may accelerate with: in a fall, little thrust turns little."""
_TIPPED = 3.0
"""Most tilt, in attitude errors that the torque corrects at once: tipped by more, at little gravity and
in thick air, motors at their limits rocked a vehicle up and away."""
_STEADY = 0.73
"""Share of the torque that the setpoint may ask for; the rest corrects errors."""
_SNAP = 0.63
"""Highest snap after a reversed jerk, in jerks per lag: 2 t/T^2 exp(-t/T), led by less than T."""
_KINK = 0.1
"""Share of the torque that a step of drag's second rate may ask for: |v| v has one at rest."""
_UPRIGHT = 0.17
"""Attitude error (rad, ten degrees) that the torque must be able to correct."""
_AHEAD = 0.01
"""Yaw error (rad) that the rotors' drag must be able to correct, or the vehicle spins in its turns."""
_SPINNING = 1000.0
"""The same error (rad) above which motors that are late in a turn spin the vehicle: with 3000 bodies
fly as with 1, with 10 000 some leave the cage."""
_LEAST_SPARE, _LEAST_SPEED = 0.12, 0.1
"""Least spare acceleration, m/s^2, and speed, m/s: with less, safety takes a flight for a standstill."""
_LEAST_ACCELERATION = 0.2
"""Least acceleration, m/s^2: at 0.13, a vehicle that turns round is slower than 0.05 m/s for up to a
second, and safety takes it for one that stands still."""
_CLIMBS = tuple(pi / 6 * step for step in range(-3, 4))
"""Angles of motion, rad, at which the acceleration left is compared: steepest sinking to climb."""
_HALVINGS = 30
"""Bisection steps for a speed: to 1e-9 of the limit."""
_CLOSE = 1e-12
"""Relative precision of roots; it takes some ten rounds."""
_KEPT = 64
"""Results that are kept of each function."""

_P = ParamSpec("_P")
_T = TypeVar("_T")


def _by_value(judge: Callable[_P, _T]) -> Callable[_P, _T]:
    """Keep a function's latest results, by the values of its tables.

    Each node judges each vehicle of a run several times, and most vehicles have the same values. The
    tables are changed in place, so the same table may have other values later.
    """
    kept: dict[bytes, _T] = {}

    @wraps(judge)
    def judged(*tables: _P.args, **named: _P.kwargs) -> _T:
        values = msgspec.msgpack.encode((tables, named))
        found = kept.get(values)
        if found is None:
            if len(kept) >= _KEPT:
                kept.clear()
            found = kept[values] = judge(*tables, **named)
        return found

    return judged


def why_not(vehicle: VehicleParams, control: ControlParams, wind: WindParams) -> str:
    """Return why these do not fly, or an empty string if they do."""
    moments = sorted((vehicle.inertia.x, vehicle.inertia.y, vehicle.inertia.z))
    if moments[2] > _ROUNDED * (moments[0] + moments[1]):
        return (
            f"no body has this inertia: {moments[2]:g} kg m^2 is more than the other two together"
        )
    damped = damping(vehicle, control)
    if damped < LEAST_DAMPING:
        kind = "unstable" if damped <= 0 else "hardly damped"
        return (
            f"{kind}: the gains and motor_lag {vehicle.motor_lag:g} s give a damping of"
            f" {damped:.2g}, below {LEAST_DAMPING:g}"
        )
    stiffness = control.velocity_gain * control.attitude_gain
    if stiffness < _STIFF:
        return (
            f"too soft: velocity_gain times attitude_gain is {stiffness:.2g} /s^2, below {_STIFF:g}"
        )
    if control.velocity_gain < _BRISK:
        return f"too soft: velocity_gain is {control.velocity_gain:.2g} /s, below {_BRISK:g}"
    if control.position_gain < _FIRM:
        return f"too soft: position_gain is {control.position_gain:.2g} /s, below {_FIRM:g}"
    if why := why_not_held(vehicle, control, wind):
        return why
    limits = flown(vehicle, control, wind)
    if limits.max_speed < _LEAST_SPEED:
        return (
            f"against the air it flies at {limits.max_speed:.2g} m/s at most, below"
            f" {_LEAST_SPEED:g}"
        )
    if limits.max_acceleration < _LEAST_ACCELERATION:
        return (
            f"it speeds up with {limits.max_acceleration:.2g} m/s^2 at most, below"
            f" {_LEAST_ACCELERATION:g}"
        )
    error = _corrected(vehicle, control)
    if error < _UPRIGHT:
        return (
            f"its torque corrects an attitude error of {error:.2g} rad, less than {_UPRIGHT:g}:"
            " too much inertia, or gains too hard for its arms and motors"
        )
    spin = vehicle.torque_coefficient / vehicle.thrust_coefficient * vehicle.mass * vehicle.gravity
    error = spin / vehicle.inertia.z / (control.rate_gain * control.attitude_gain)
    if error < _AHEAD:
        return (
            f"its rotors' drag corrects a yaw error of {error:.2g} rad, less than {_AHEAD:g}:"
            " too much inertia, or too small a torque_coefficient"
        )
    if error > _SPINNING:
        return (
            f"its rotors' drag corrects a yaw error of {error:.2g} rad, more than {_SPINNING:g}: the"
            " smallest difference of its motors spins it; too large a torque_coefficient, or too"
            " small a thrust_coefficient"
        )
    return ""


def why_not_held(vehicle: VehicleParams, control: ControlParams, wind: WindParams) -> str:
    """Return why a vehicle that flies in still air cannot hold its place, or an empty string."""
    spare, cause = _spare(vehicle, control, *_air(wind, _STORM))
    return f"it cannot hold itself: {cause}" if spare < _LEAST_SPARE else ""


class FlownLimits(NamedTuple):
    """Limits of the setpoint: those of the parameters, or less where the vehicle cannot fly them."""

    max_speed: float
    """m/s"""
    max_acceleration: float
    """m/s^2"""
    acceleration_at_speed: float
    """Acceleration (m/s^2) to speed up with at the highest speed; drag takes the rest."""
    max_jerk: float
    """m/s^3"""
    max_tilt: float
    """rad"""


@_by_value
def flown(vehicle: VehicleParams, control: ControlParams, wind: WindParams) -> FlownLimits:
    """Return the limits that the vehicle can fly in its wind.

    In a wind that it cannot hold, those of still air: it has to stop and land there.
    """
    if why_not_held(vehicle, control, wind):
        wind = WindParams()
    across, up = _air(wind)
    snap = _turning(vehicle) * vehicle.gravity
    most = min(
        control.max_acceleration,
        _FLOWN * _spare(vehicle, control, across, up)[0],
        _ASKED * vehicle.gravity,
        sqrt(_KINK * snap * vehicle.mass / (4 * vehicle.drag)) if vehicle.drag else inf,
    )

    def left(speed: float) -> float:
        """Return the acceleration left at this speed (m/s) against the air, m/s^2."""
        airs = ((across + speed * cos(a), up + speed * sin(a)) for a in _CLIMBS)
        return _FLOWN * min(_spare(vehicle, control, *air)[0] for air in airs)

    lag, gain = setpoint_lag(vehicle, control), control.velocity_gain

    def held(speed: float) -> float:
        """Return how hard the air holds the vehicle at this speed (m/s), 1/s."""
        return _linear_drag(vehicle, speed + hypot(across, up)) / vehicle.mass

    def jerk(speed: float) -> float:
        """Return the highest jerk at this speed (m/s), m/s^3."""
        # Drag's second rate goes with the jerk, and adds to the snap.
        return min(control.max_jerk, _STEADY * snap / (_SNAP / lag + held(speed)))

    def flies(speed: float) -> bool:
        """Return whether the vehicle can speed up at this speed (m/s), and fly what exceeds it."""
        # An axis that gives up half its share ends its acceleration with half the jerk. At most the
        # speed itself: a higher acceleration is not reached within it.
        square, ends = most * most, jerk(speed)
        more = speed if square >= speed * ends else square / ends
        return (
            left(speed) >= _AT_SPEED * most
            and left(speed + more) >= _BEYOND * most
            and held(speed) <= _HELD * gain
            and control.position_gain * gain >= _FIRM * (gain + held(speed))
        )

    speed, step = control.max_speed, 0.5 * control.max_speed
    if not flies(speed):
        speed = 0.0
        for _ in range(_HALVINGS):
            speed += step if flies(speed + step) else 0.0
            step *= 0.5
    tilt = held_tilt(vehicle, control)
    return FlownLimits(speed, most, min(most, left(speed)), jerk(speed), tilt)


def held_tilt(vehicle: VehicleParams, control: ControlParams) -> float:
    """Return the tilt (rad) that the controller asks for at most: no more than the torque rights."""
    return min(control.max_tilt, max(_TIPPED * _corrected(vehicle, control), 0.0))


def _corrected(vehicle: VehicleParams, control: ControlParams) -> float:
    """Return the attitude error (rad) that the torque corrects at once.

    Beyond it the mixer adds thrust, which a tilted vehicle cannot use: it tumbles.
    """
    return _turning(vehicle) / (control.rate_gain * control.attitude_gain)


def delay(vehicle: VehicleParams) -> float:
    """Return the time (s) from a motor command to its effect: the motors' lag and half a period."""
    return vehicle.motor_lag + 0.5 * CONTROL_PERIOD


def setpoint_lag(vehicle: VehicleParams, control: ControlParams) -> float:
    """Return the time constant (s) of each of the three lags that round the setpoint."""
    lag = delay(vehicle)
    # The roots of the loop take time: fast motors do without them.
    if _SLOWER * lag > _LEAST_LAG and damping(vehicle, control) < _SWINGS:
        lag *= _SLOWER
    return max(lag, _LEAST_LAG)


def limited(vehicle: VehicleParams, control: ControlParams, wind: WindParams) -> list[str]:
    """Return a line on a wind that it cannot hold, or one for each limit that it flies with less of."""
    if why := why_not_held(vehicle, control, wind):
        return [why]
    less = flown(vehicle, control, wind)
    spare, _ = _spare(vehicle, control, *_air(wind))
    is_dragged = less.max_acceleration < min(_FLOWN * spare, _ASKED * vehicle.gravity)
    reasons = {
        "max_acceleration": f"{'for its drag' if is_dragged else f'the body can do {spare:.2g} m/s^2,'}"
        " flown with",
        "max_speed": "against the air flown with",
        "max_jerk": "for its torque flown with",
        "max_tilt": "for its torque flown with",
    }
    return [
        f"{name} {getattr(control, name):g}: {reason} {getattr(less, name):.2g}"
        for name, reason in reasons.items()
        if getattr(less, name) < getattr(control, name)
    ]


def _air(wind: WindParams, gusts: float = _GUSTS) -> tuple[float, float]:
    """Return the horizontal and the upward wind, m/s, with so many RMS values of gusts across."""
    return hypot(wind.mean.x, wind.mean.y) + gusts * wind.gust, wind.mean.z


def _linear_drag(vehicle: VehicleParams, speed: float) -> float:
    """Return the rate of drag with the speed through the air, N/(m/s), at this speed, m/s."""
    most = max(vehicle.rotor_drag.across, vehicle.rotor_drag.along)
    return vehicle.linear_drag + _rotation(vehicle) * most + 2 * vehicle.drag * speed


def _rotation(vehicle: VehicleParams) -> float:
    """Return the sum of the motor speeds in hover, rad/s."""
    return 4 * sqrt(0.25 * vehicle.mass * vehicle.gravity / vehicle.thrust_coefficient)


def _turning(vehicle: VehicleParams) -> float:
    """Return the angular acceleration (rad/s^2) about x and y that leaves the hover thrust as it is.

    In X configuration, the worst direction takes an equal share of roll and pitch.
    """
    hover = 0.25 * vehicle.mass * vehicle.gravity
    room = min(hover, vehicle.thrust_coefficient * vehicle.max_motor_speed**2 - hover)
    return 2 * vehicle.arm * room / max(vehicle.inertia.x, vehicle.inertia.y)


def _spare(
    vehicle: VehicleParams, control: ControlParams, across: float, up: float
) -> tuple[float, str]:
    """Return the spare acceleration (m/s^2) in every direction in this air, m/s, and its limit.

    With gravity g, drag d and lift w: A cos f + d <= tan(tilt) (g - w + A sin f) for all f, in
    closed form.
    """
    g, tilt = vehicle.gravity, held_tilt(vehicle, control)
    full = 4 * vehicle.thrust_coefficient * vehicle.max_motor_speed**2 / vehicle.mass
    rotation = _rotation(vehicle)
    speed = hypot(across, up)
    linear = vehicle.linear_drag + vehicle.drag * speed
    drag = (linear + rotation * vehicle.rotor_drag.across) * across / vehicle.mass
    # Rotors that are dragged more across than along tilt the lift: the larger of both counts.
    along = max(vehicle.rotor_drag.across, vehicle.rotor_drag.along)
    lift = (linear + rotation * along) * up / vehicle.mass
    held = (g - lift) * tan(tilt)
    return min(
        (
            _SINK * g - lift,
            (
                f"the air lifts it by {lift:.3g} m/s^2, and it sinks with at most {_SINK * g:.3g}"
                if lift
                else "without gravity it can neither sink nor accelerate sideways"
            ),
        ),
        (
            (g - lift) * sin(tilt) - drag * cos(tilt),
            f"wind of {speed:.3g} m/s pushes by {drag:.3g} m/s^2, max_tilt holds {held:.3g}",
        ),
        (
            _LIFT * full - hypot(g - lift, drag),
            (
                f"its motors lift {_LIFT * full:.3g} m/s^2 at most, and gravity"
                f"{' and wind pull' if lift < 0 else ' pulls'} {g - lift:.3g}"
            ),
        ),
        key=lambda each: each[0],
    )


@_by_value
def damping(vehicle: VehicleParams, control: ControlParams) -> float:
    """Return the least damping of the closed loop's modes: 1 does not swing, 0 and less grows."""
    kp, kv = control.position_gain, control.velocity_gain
    ka, kr = control.attitude_gain, control.rate_gain
    loop = (delay(vehicle), 1.0, kr, kr * ka, kr * ka * kv, kr * ka * kv * kp)
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
