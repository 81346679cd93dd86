"""Airworthiness: bodies and gains near one that was flown, the limits that each can fly, and its margin.

Promises hold for vehicles with each parameter and gain near that of one of BODIES; searches flew the whole
range. For these the rest is in closed form. The spare acceleration is that in the worst direction. The
damping is that of the linear loop from position to thrust: cascaded gains, and the motors' lag plus half
a control period. The torque is what roll and pitch have in hover before the mixer adds thrust to make
room for them. SI units.

Not covered: motors that a fault weakens, and thrust that the mixer adds while a wind near the limit turns
round: one in a thousand random bodies then gets a fifth farther than its margin.
"""

from collections.abc import Iterable, Iterator
from functools import lru_cache
from math import cos, dist, exp, hypot, inf, pi, sin, sqrt, tan
from typing import Any, NamedTuple

import msgspec

from quadctl.schemas.params import WindParams, by_value
from quadctl.schemas.topics import SETPOINT
from quadctl.schemas.vehicle import ControlParams, InertiaParams, RotorDragParams, VehicleParams
from quadctl.services.airspace.stopping import AT_REST, PATIENCE, StoppingLaw


class Body(NamedTuple):
    """Vehicle that was flown, with the gains for it."""

    name: str
    vehicle: VehicleParams
    control: ControlParams


BODIES = (
    Body("the lab's vehicle", VehicleParams(), ControlParams()),
    Body(
        "a Crazyflie 2.0",
        VehicleParams(
            mass=0.03, inertia=InertiaParams(1.43e-5, 1.43e-5, 2.89e-5), arm=0.043,
            thrust_coefficient=2.3e-8, torque_coefficient=7.8e-10, max_motor_speed=2500.0,
            motor_lag=0.072, drag=0.0, rotor_drag=RotorDragParams(10.2506e-7, 7.553e-7),
        ),
        ControlParams(1.0, 2.2, 4.0, 12.0, 0.6, 2.0, 2.5, 12.0),
    ),
)  # fmt: skip
_NEAR_BODY, _NEAR_GAINS = 2.0, 1.5
"""Factors within which a body's parameters, and its gains, are near."""
_SOFTER = 8.0
"""Factor by which its jerk may be less; it may be more, as what can be flown follows from the torque."""
_DRAG = ("drag", "linear_drag", "rotor_drag")
_LIMITS = ("max_tilt", "max_speed", "max_acceleration")
"""Parameters that are near at any value: the limits that can be flown follow from drag and from these."""

CONTROL_PERIOD = 0.004
"""Seconds between two motor commands."""
_LEAST_LAG, _SLOWER = 0.05, 1.5
"""Shortest lag of the setpoint, s, and how many times longer than the motors' delay it is."""
LAGS_TO_SPIN_UP = 5.0
"""Motor lags to wait at hover command before take-off: 1.3 % of the weight is missing then."""
_LAGS = 3.0
"""Lags of the setpoint by which the vehicle may be behind it, and lags after which a loop has settled."""
LEAST_DAMPING = 0.2
"""Damping ratio: with less, a loop swings for long, and with 0 for ever."""
_LIFT = 0.9
"""Share of the full thrust that the vertical may take."""
_SINK = 0.8
"""Share of gravity that the vehicle may fall with."""
_GUSTS, _STORM = 2.0, 4.0
"""RMS values of the gusts added to the mean wind: to fly in it, and to hold one's place for hours."""
_ESTIMATED = 0.1
"""Lag of the controller's estimate of the air, s."""
_SWAY, _RIGHTED = 6.0, 1.5
"""RMS values of what gusts do: to the place, passed once in some 10^8 times; to the acceleration that is
left for it in the strongest one."""
_ROUNDED = 1.1
"""Factor on sums of measured moments of inertia, against their errors."""
_FLOWN, _ASKED = 0.9, 0.58
"""Shares of the spare acceleration, and of gravity, that the setpoint may ask for."""
_AT_SPEED = 0.5
"""Least share of the highest acceleration that is left to speed up at the highest speed."""
_HELD = 0.5
"""Most that the air may hold the vehicle, in velocity gains: an error of the place lasts longer by it."""
_LATE, _STRAY = 0.2, 0.01
"""Share of the thrust's lag that is not led, as thrust goes with the square of what lags; and most, m, that
the vehicle may stray by it."""
_TIPPED = 3.0
"""Most tilt, in attitude errors that the torque corrects at once."""
_STEADY = 0.73
"""Share of the torque that the setpoint may ask for; the rest corrects errors."""
_SNAP = 0.63
"""Highest snap after a reversed jerk, in jerks per lag: 2 t/T^2 exp(-t/T), led by less than T."""
_LEAST_SPARE, _LEAST_SPEED, _LEAST_ACCELERATION = 0.12, 0.1, 0.2
"""Least spare acceleration, m/s^2, speed, m/s, and acceleration of a setpoint, m/s^2: with less, safety
takes a flight, or a turn, for a standstill. So it does if a vehicle takes longer than its patience to move."""
_CLIMBS = tuple(pi / 6 * step for step in range(-3, 4))
"""Angles of motion, rad, at which the acceleration left is compared: steepest sinking to climb."""
_HALVINGS = 12
"""Bisection steps for a speed: to 1/4096 of the limit, from below."""
_CLOSE, _ROUNDS = 1e-12, 60
"""Relative precision of roots, which takes some ten rounds, 30 at most; and where several are one, so that
rounding hides it, the rounds after which they change no more."""


@by_value
def why_unproven(vehicle: VehicleParams, control: ControlParams) -> str:
    """Return which parameters are too far from those of the nearest body for a promise, or an empty string."""
    found = [(_far(vehicle, control, body), body.name) for body in BODIES]
    far, name = min(found, key=lambda one: len(one[0]))
    return f"{', '.join(far)}: no promise holds so far from {name}" if far else ""


def _far(vehicle: VehicleParams, control: ControlParams, body: Body) -> list[str]:
    tables = (vehicle, body.vehicle, _NEAR_BODY), (control, body.control, _NEAR_GAINS)
    ranges = (
        (
            name,
            value,
            *((like / _SOFTER, inf) if name == "max_jerk" else (like / factor, like * factor)),
        )
        for table, known, factor in tables
        for (name, value), (_, like) in zip(_leaves(table), _leaves(known), strict=True)
    )
    return [
        f"{name} {value:g} is not within {low:.3g} to {high:.3g}"
        for name, value, low, high in ranges
        if not low <= value <= high
    ]


def _leaves(table: Any) -> Iterator[tuple[str, float]]:
    for name, value in msgspec.to_builtins(table).items():
        if name in {*_DRAG, *_LIMITS}:
            continue
        if isinstance(value, dict):
            yield from ((f"{name}.{axis}", part) for axis, part in value.items())
        else:
            yield name, value


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
    if why := why_not_held(vehicle, control, wind):
        return why
    speed, acceleration, _, jerk, _ = flown(vehicle, control, wind)
    if speed < _LEAST_SPEED:
        return f"against the air it flies at {speed:.2g} m/s at most, below {_LEAST_SPEED:g}"
    if acceleration < _LEAST_ACCELERATION:
        least = f"{acceleration:.2g} m/s^2 at most, below {_LEAST_ACCELERATION:g}"
        return f"it speeds up with {least}"
    # It has to move within safety's patience, on the floor after its motors have spun up.
    begins = LAGS_TO_SPIN_UP * vehicle.motor_lag + _LAGS * setpoint_lag(vehicle, control)
    begins += sqrt(2 * AT_REST / jerk)
    if begins > PATIENCE:
        return (
            f"with motor_lag {vehicle.motor_lag:g} s and a jerk of {jerk:.2g} m/s^3 it takes"
            f" {begins:.2g} s to take off, above {PATIENCE:g}"
        )
    return ""


def why_not_held(vehicle: VehicleParams, control: ControlParams, wind: WindParams) -> str:
    """Return why a vehicle that flies in still air cannot hold its place, or an empty string.

    In the strongest gust it must be able to correct what gusts have done to it, too.
    """
    spare, cause = _spare(vehicle, control, *_air(wind, _STORM))
    righted = sqrt(control.velocity_gain + control.position_gain)
    least = max(_LEAST_SPARE, _RIGHTED * righted * _hidden(vehicle, control, wind, 0.0))
    return f"it cannot hold itself: {cause}" if spare < least else ""


def wind_margin(
    vehicle: VehicleParams,
    control: ControlParams,
    wind: WindParams,
    before: Iterable[WindParams] = (),
) -> float:
    """Return how far (m) wind and gusts may move the vehicle off its place, to add to `safety.margin`.

    A vehicle that leaves the floor has the wind all at once, and one in flight its change, from any of the winds
    `before` that it may still be tilted against. Until it has tilted, which takes it the attitude's lag and more
    if the loop swings, it is blown along. In gusts it has to learn a new mean first. From the speed that it then
    has, the loop of position and velocity stops it in v / kv, or with all that it can do in v^2 / 2a.
    """
    damped = min(max(damping(vehicle, control), 0.0), 1 - _CLOSE)
    late = (1 + exp(-pi * damped / sqrt(1 - damped * damped))) / control.attitude_gain
    v = late * _push(vehicle, WindParams(), wind)
    for push in (_push(vehicle, earlier, wind) for earlier in before):
        # Half of the time in which the torque tilts it the fastest, if that is more.
        tilt = min(push / vehicle.gravity, 2 * held_tilt(vehicle, control))
        turned = max(late, sqrt(tilt / _turning(vehicle)))
        v = max(v, push * (turned + (_ESTIMATED if wind.gust else 0.0)))
    spare = max(_spare(vehicle, control, *_air(wind, _STORM))[0], _LEAST_SPARE)
    blown = v / control.velocity_gain + 0.5 * v * v / spare
    return blown + _SWAY * sway(vehicle, control, wind)


def _push(vehicle: VehicleParams, before: WindParams, wind: WindParams) -> float:
    """Return the greatest acceleration (m/s^2) that a change of the wind gives a vehicle at rest.

    The strongest gusts of both are against each other, along the change.
    """
    old, new = ((w.mean.x, w.mean.y, w.mean.z) for w in (before, wind))
    change = [n - o for n, o in zip(new, old, strict=True)]
    along = next(filter(any, (change, new)), (1.0, 0.0, 0.0))
    forces = []
    for mean, gust in ((old, -before.gust), (new, wind.gust)):
        air = [m + _STORM * gust * (to / hypot(*along)) for m, to in zip(mean, along, strict=True)]
        drag = _linear_drag(vehicle, 0.5 * hypot(*air))
        forces.append([drag * part for part in air])
    return dist(*forces) / vehicle.mass


def settled(control: ControlParams) -> float:
    """Return the time (s) after which a vehicle that was blown off its place is back."""
    return _LAGS / control.position_gain


def least_range(vehicle: VehicleParams, control: ControlParams, wind: WindParams) -> float:
    """Return the least acceptance range (m): nearer, a vehicle would be taken for one that does not follow.

    The last of the way goes with the rate of the position's gain, and gusts move the vehicle all the time.
    """
    rate = control.position_gain
    return AT_REST / rate * exp(-rate * PATIENCE) + sway(vehicle, control, wind)


def sway(vehicle: VehicleParams, control: ControlParams, wind: WindParams) -> float:
    """Return an upper bound (m) of the RMS on an axis of how far gusts move the vehicle off its place."""
    speed = flown(vehicle, control, wind).max_speed if wind.gust else 0.0
    unknown = _hidden(vehicle, control, wind, speed)
    return unknown / (control.velocity_gain * sqrt(control.position_gain))


def _hidden(
    vehicle: VehicleParams, control: ControlParams, wind: WindParams, speed: float
) -> float:
    """Return the noise of the acceleration by gusts that the vehicle has not yet tilted against, m/s^1.5.

    A gust of Dryden is white noise through a lag, the time in which the air carries its length past.
    The tilt follows the air by the lags of its estimate and of the attitude. White noise n into the loop
    of position and velocity moves the place by n / (kv sqrt(kp)), and its correction by n sqrt(kv + kp)
    (RMS, from the loop's Lyapunov equation). Drag is taken in the strongest gust, at this `speed`, m/s.
    """
    mean = hypot(wind.mean.x, wind.mean.y, wind.mean.z)
    drag = _linear_drag(vehicle, mean + _STORM * wind.gust + speed) / vehicle.mass
    late = _ESTIMATED + 1 / control.attitude_gain
    return drag * late * wind.gust * sqrt(hypot(mean, wind.gust) / wind.gust_length)


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


@by_value
def flown(vehicle: VehicleParams, control: ControlParams, wind: WindParams) -> FlownLimits:
    """Return the limits that the vehicle can fly in its wind.

    In a wind that it cannot hold, those of still air: it has to stop and land there.
    """
    if why_not_held(vehicle, control, wind):
        wind = WindParams()
    across, up = _air(wind)
    most = min(
        control.max_acceleration,
        _FLOWN * _spare(vehicle, control, across, up)[0],
        _ASKED * vehicle.gravity,
    )

    def left(speed: float) -> float:
        """Return the acceleration left at this speed (m/s) against the air, m/s^2."""
        airs = ((across + speed * cos(a), up + speed * sin(a)) for a in _CLIMBS)
        return _FLOWN * min(_spare(vehicle, control, *air)[0] for air in airs)

    def held(speed: float) -> float:
        """Return how hard the air holds the vehicle at this speed (m/s), 1/s."""
        return _linear_drag(vehicle, speed + hypot(across, up)) / vehicle.mass

    def flies(speed: float) -> bool:
        """Return whether the vehicle can speed up at this speed, m/s."""
        return left(speed) >= _AT_SPEED * most and held(speed) <= _HELD * control.velocity_gain

    speed, step = control.max_speed, 0.5 * control.max_speed
    if not flies(speed):
        speed = 0.0
        for _ in range(_HALVINGS):
            speed += step if flies(speed + step) else 0.0
            step *= 0.5
    # What the thrust's lag hides of a change of drag moves the vehicle off its place.
    hidden = _LATE * delay(vehicle) * held(speed) / (control.velocity_gain * control.position_gain)
    most = min(most, _STRAY / hidden) if hidden else most
    # Drag's second rate goes with the jerk, and adds to the snap.
    snap = _turning(vehicle) * vehicle.gravity
    jerk = _STEADY * snap / (_SNAP / setpoint_lag(vehicle, control) + held(speed))
    return FlownLimits(
        speed,
        most,
        min(most, left(speed)),
        min(control.max_jerk, jerk),
        held_tilt(vehicle, control),
    )


def stopping_law(vehicle: VehicleParams, control: ControlParams, wind: WindParams) -> StoppingLaw:
    """Return the law of a stop with the limits that the vehicle can fly in its wind.

    The newest pose may be a period old. The setpoint may still gain the acceleration that the limits
    permit, which then ends with the jerk; three lags delay both. Axes that divide the limits badly brake
    with half of them.
    """
    limits = flown(vehicle, control, wind)
    most = min(limits.max_acceleration, sqrt(2 * limits.max_jerk * limits.max_speed))
    response = 1 / SETPOINT.hz + _LAGS * setpoint_lag(vehicle, control) + most / limits.max_jerk
    return StoppingLaw(response, most, 0.5 * most)


def most_motion(
    vehicle: VehicleParams, control: ControlParams, wind: WindParams
) -> tuple[float, float]:
    """Return the highest speed (m/s) and deceleration (m/s^2) of a sound flight.

    The vehicle may still speed up for the lags by which it follows its setpoint.
    """
    limits = flown(vehicle, control, wind)
    gained = _LAGS * setpoint_lag(vehicle, control) * limits.max_acceleration
    return limits.max_speed + gained, limits.max_acceleration


def held_tilt(vehicle: VehicleParams, control: ControlParams) -> float:
    """Return the tilt (rad) that the controller asks for at most: no more than the torque rights.

    Beyond the attitude error that the torque corrects at once, the mixer adds thrust, which a tilted
    vehicle cannot use: it tumbles.
    """
    corrected = _turning(vehicle) / (control.rate_gain * control.attitude_gain)
    return min(control.max_tilt, max(_TIPPED * corrected, 0.0))


def delay(vehicle: VehicleParams) -> float:
    """Return the time (s) from a motor command to its effect: the motors' lag and half a period."""
    return vehicle.motor_lag + 0.5 * CONTROL_PERIOD


def setpoint_lag(vehicle: VehicleParams, control: ControlParams) -> float:
    """Return the time constant (s) of each of the three lags that round the setpoint."""
    return max(_SLOWER * delay(vehicle), 1 / control.rate_gain, _LEAST_LAG)


def limited(vehicle: VehicleParams, control: ControlParams, wind: WindParams) -> list[str]:
    """Return lines on what limits its flights: no promise, its wind, and each limit that it flies with less of."""
    lines = [why] if (why := why_unproven(vehicle, control)) else []
    if why := why_not_held(vehicle, control, wind):
        return [*lines, why]
    if blown := wind_margin(vehicle, control, wind):
        lines.append(f"the wind adds {blown:.2g} m to safety.margin")
    less = flown(vehicle, control, wind)
    spare, _ = _spare(vehicle, control, *_air(wind))
    by_drag = less.max_acceleration < min(_FLOWN * spare, _ASKED * vehicle.gravity)
    reasons = {
        "max_acceleration": (
            "for its drag and the motors' lag flown with"
            if by_drag
            else f"the body can do {spare:.2g} m/s^2, flown with"
        ),
        "max_speed": "against the air flown with",
        "max_jerk": "for its torque flown with",
        "max_tilt": "for its torque flown with",
    }
    return lines + [
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


def damping(vehicle: VehicleParams, control: ControlParams) -> float:
    """Return the least damping of the closed loop's modes: 1 does not swing, 0 and less grows."""
    kp, kv = control.position_gain, control.velocity_gain
    ka, kr = control.attitude_gain, control.rate_gain
    loop = (delay(vehicle), 1.0, kr, kr * ka, kr * ka * kv, kr * ka * kv * kp)
    return min(-root.real / abs(root) for root in _roots(loop))


@lru_cache
def _roots(coefficients: tuple[float, ...]) -> list[complex]:
    """Return a polynomial's roots, the highest power first, by Durand and Kerner's method."""
    first, last, order = coefficients[0], coefficients[-1], len(coefficients) - 1
    scale = (last / first) ** (1 / order)
    monic = [value / (first * scale**power) for power, value in enumerate(coefficients)]
    roots = [(0.4 + 0.9j) ** number for number in range(order)]
    for _ in range(_ROUNDS):
        moved = 0.0
        for number, root in enumerate(roots):
            above, below = 0j, 1 + 0j
            for value in monic:
                above = above * root + value
            for other in roots[:number] + roots[number + 1 :]:
                below *= root - other
            roots[number] = root - above / below
            moved = max(moved, abs(above / below) / abs(root))
        if moved <= _CLOSE:
            break
    return [scale * root for root in roots]
