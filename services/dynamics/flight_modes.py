"""Modes of a flight: standing, spin-up, flying, hopping, landing, at rest; the room for a stop.

Over the floor the vehicle hops, it leaves the floor straight up, and it lands from straight above: a
path along the floor, or diagonally from or to it, would scrape it, and contact removes all speed. It
turns round by a stop, so that no goal leads it farther out than a stop does. A vehicle at rest does
not change a bit until its next command: further steps would only change the last digits.

World frame ENU, SI units. Straight-line code, as in rigidbody.py.
"""

from math import nan

from quadctl.services.airspace.geometry import Point
from quadctl.services.dynamics import trajectory, wind
from quadctl.services.dynamics.controller import STEPS, Gains, Setpoint, Wind, control
from quadctl.services.dynamics.rigidbody import Body, Motors, State, step
from quadctl.services.dynamics.rotor import Mixer, mix
from quadctl.services.dynamics.trajectory import Limits, Plan
from quadctl.services.dynamics.wind import Air, Weather

HOP = 0.1
"""Height of a hop, m: less than the height of any cage."""
NEAR = 0.01
"""Distance (m) of a place on the floor that needs no hop: the vehicle is there, or lands there."""
FLAT = 0.05
"""Slope (height over way) below which a climb begins with a hop."""
CLOSE, ABOVE = 0.05, 0.002
"""Distances (m) to the end of a leg at which the next one begins, and to a landing's place."""
LIFT = 1e-6
"""Height (m) at which the setpoint of a climb from the floor may turn to the side, once it rises."""
TOUCHDOWN, CONTACT = 0.01, 0.0003
"""Heights (m) under which a vehicle may drop: with its setpoint at rest, and before."""
REST = 1e-9
"""Tolerance of a vehicle at rest in place, attitude and motion: m, rad, m/s and rad/s."""
MOTORS_AT_REST = 1e-6
"""Tolerance of its motors against their command, rad/s."""
PERIODS_TO_REST = 25.0
"""Control periods of rest, 0.1 s, after which no force can be acting on the vehicle."""

BRAKES, TURNS = 1.0, 2.0
"""Marks of a vehicle that comes to rest, or that brakes before it departs, see `depart`."""

FlightMode = tuple[float, float, float, float, float, float, float, float]
"""1 while standing; periods left to spin up; periods at rest; BRAKES, TURNS or 0; legs of a hop
still to come after this one, 2 to 0; and the last goal, nan before the first."""

Constants = tuple[Body, Gains, Mixer, Limits, float, float, Weather]
"""Constants of a vehicle: for the body, the controller, the mixer and the setpoint, its weight (N),
the control periods of its spin-up, and the weather."""


def fresh(*, standing: bool) -> FlightMode:
    """Return the mode of a vehicle without a goal, on the floor or hovering."""
    return (1.0 if standing else 0.0, 0.0, 0.0, 0.0, 0.0, nan, nan, nan)


def woken(mode: FlightMode) -> FlightMode:
    """Return the mode with the count of periods at rest set to 0, after any change."""
    standing, spin, _, braking, hop, tx, ty, tz = mode
    return (standing, spin, 0.0, braking, hop, tx, ty, tz)


def goto(
    plan: Plan, mode: FlightMode, x: float, y: float, z: float, spin_up: float, limits: Limits
) -> tuple[Plan, FlightMode]:
    """Fly to a point, m; a repeated goal changes nothing.

    From the floor the motors first spin up for `spin_up` periods. A goal below it is one on it.
    """
    standing, spin, _, braking, hop, tx, ty, tz = mode
    z = z if z > 0.0 else 0.0
    if (x != tx) | (y != ty) | (z != tz) | (braking == BRAKES):
        plan, mode = depart(plan, (standing, spin, 0.0, braking, hop, x, y, z), spin_up, limits)
    return plan, mode


def depart(plan: Plan, mode: FlightMode, spin_up: float, limits: Limits) -> tuple[Plan, FlightMode]:
    """Return the plan and the mode of a flight that begins now, to the mode's goal.

    A vehicle that would pass the end of its first leg brakes first: if the limits were divided for a
    flight to there at once, an axis that has to turn round would get less than in a stop.
    """
    standing, spin, calm, braking, hop, x, y, z = mode
    sx, sy, sz = place(plan, limits)
    ex, ey, ez = trajectory.stopping_place(plan, limits)
    way = (x - sx) * (x - sx) + (y - sy) * (y - sy)
    # Passing over a place is not being there.
    passed = (x - ex) * (x - ex) + (y - ey) * (y - ey)
    here = (way <= NEAR * NEAR) & (passed <= NEAR * NEAR)
    begins = (standing == 0.0) | (z > 0.0) | (here == 0.0)
    low = (z < HOP) & (here == 0.0)
    # A flat climb, or one begun in motion over the floor, would scrape it, too.
    moves = (here == 0.0) & (plan[6] < limits[6])
    flat = (z - sz) * (z - sz) < FLAT * FLAT * way
    # Contact takes the speed to the side, and a soft velocity_gain takes long to make up for
    # it: near the floor a flight begins straight up, once the vehicle has stopped as `brake` does it.
    rises = (sz < HOP - REST) | (ez < HOP - REST)
    lands = rises & (here > 0.0) & (z <= 0.0)
    hops = rises & (lands == 0.0) & (low | moves | flat)
    sideways = (plan[0][1] != 0.0) | (plan[0][2] != 0.0) | (plan[1][1] != 0.0) | (plan[1][2] != 0.0)
    lx = plan[0][0] if rises else x
    ly = plan[1][0] if rises else y
    lz = HOP if hops | low else z
    if begins & ((rises & sideways) | trajectory.passes(plan, lx, ly, lz, limits)):
        plan, mode = brake(plan, mode, limits)
        braking = TURNS
        hop = 0.0
    else:
        braking = 0.0
        if begins:
            spin = spin_up if standing > 0.0 else spin
            standing = 0.0
            hop = (1.0 if rises & (lands == 0.0) else 0.0) + (1.0 if low else 0.0)
            plan = trajectory.goto(plan, lx, ly, lz, limits)
    return plan, (standing, spin, calm, braking, hop, x, y, z)


def brake(plan: Plan, mode: FlightMode, limits: Limits) -> tuple[Plan, FlightMode]:
    """Come to rest as soon as the setpoint can; while braking, change nothing."""
    standing, spin, calm, braking, hop, tx, ty, tz = mode
    if braking == 0.0:
        plan = trajectory.brake(plan, limits)
        calm = 0.0
        hop = 0.0
    return plan, (standing, spin, calm, BRAKES, hop, tx, ty, tz)


def place(plan: Plan, limits: Limits) -> tuple[float, float, float]:
    """Return the setpoint's position, m."""
    x, _, _, _, _, _ = trajectory.filtered(plan[0], limits)
    y, _, _, _, _, _ = trajectory.filtered(plan[1], limits)
    z, _, _, _, _, _ = trajectory.filtered(plan[2], limits)
    return x, y, z


def select_mode(
    state: State, plan: Plan, mode: FlightMode, limits: Limits
) -> tuple[FlightMode, float]:
    """Return this period's mode, and the motors' command: 0 idle, 1 spin-up, 2 in flight."""
    standing, spin, calm, braking, hop, tx, ty, tz = mode
    spins = (standing == 0.0) & (spin > 0.0)
    down = trajectory.at_rest(plan, limits) & (plan[2][3] <= 0.0) & (state[2] < TOUCHDOWN)
    standing = 1.0 if (standing > 0.0) | ((spin == 0.0) & down) else 0.0
    kind = 1.0 if spins else 2.0
    kind = 0.0 if standing > 0.0 else kind
    spin = spin - 1.0 if spins else spin
    return (standing, spin, calm, braking, hop, tx, ty, tz), kind


def motor_commands(
    state: State,
    wanted: Setpoint,
    kind: float,
    weight: float,
    gains: Gains,
    mixer: Mixer,
    air: Wind,
) -> Motors:
    """Return this period's motor commands, rad/s.

    `weight` is the spin-up thrust, N, and `air` the air's velocity as the controller knows it, m/s.
    """
    thrust, tx, ty, tz = control(state, wanted, gains, air)
    flies = kind == 2.0
    c0, c1, c2, c3 = mix(
        thrust if flies else weight,
        tx if flies else 0.0,
        ty if flies else 0.0,
        tz if flies else 0.0,
        state,
        mixer,
    )
    idle = kind == 0.0
    return (0.0 if idle else c0, 0.0 if idle else c1, 0.0 if idle else c2, 0.0 if idle else c3)


def touches(height: float, plan: Plan, limits: Limits) -> bool:
    """Return whether a vehicle at this height (m) touches the floor before its setpoint has braked."""
    _, sinks, _, _, _, _ = trajectory.filtered(plan[2], limits)
    return (height < CONTACT) & (sinks < 0.0)


def next_leg(
    height: float, plan: Plan, mode: FlightMode, kind: float, spin_up: float, limits: Limits
) -> tuple[Plan, FlightMode]:
    """Return the plan one period later if the vehicle flies, with its next leg if one is due.

    That of a vehicle that turns begins once its stop no longer ends past its goal, see `depart`.

    A landing ends when the vehicle, at this height (m), touches the floor, and a climb that follows
    on it begins anew. Braking the rest of the way would push the vehicle off, with a speed that a
    soft velocity_gain takes long to end.
    """
    standing, spin, calm, braking, hop, tx, ty, tz = mode
    if kind == 2.0:
        plan = trajectory.advance(plan, limits)
        if touches(height, plan, limits):
            x, y, _ = place(plan, limits)
            ex, ey, ez = plan[0][3], plan[1][3], plan[2][3]
            plan = trajectory.resting(x, y, 0.0, limits)
            if ez > 0.0:
                plan = trajectory.goto(plan, ex, ey, ez, limits)
            else:
                standing = 1.0
        if hop > 0.0:
            x, y, z = place(plan, limits)
            ex, ey, ez = plan[0][3], plan[1][3], plan[2][3]
            _, climb, _, _, _, _ = trajectory.filtered(plan[2], limits)
            # Only the first leg of a steep climb ends higher than a hop.
            lifts = (ez > HOP) & (z > LIFT) & (climb > 0.0)
            close = ABOVE if (hop == 1.0) & (tz < HOP) else CLOSE
            far = (x - ex) * (x - ex) + (y - ey) * (y - ey) + (z - ez) * (z - ez)
            if lifts | (far < close * close):
                hop = hop - 1.0
                plan = trajectory.goto(plan, tx, ty, HOP if hop > 0.0 else tz, limits)
        mode = (standing, spin, calm, braking, hop, tx, ty, tz)
        if braking == TURNS:
            plan, mode = depart(plan, mode, spin_up, limits)
    return plan, mode


def rest(state: State, command: Motors, plan: Plan, mode: FlightMode, limits: Limits) -> FlightMode:
    """Return the mode with the periods counted in which the vehicle has been motionless."""
    standing, spin, calm, braking, hop, tx, ty, tz = mode
    on_floor = standing > 0.0
    if on_floor | trajectory.at_rest(plan, limits):
        px, py, pz, vx, vy, vz, _, qx, qy, qz, wx, wy, wz, m0, m1, m2, m3 = state
        c0, c1, c2, c3 = command
        still = (
            (abs(vx) < REST) & (abs(vy) < REST) & (abs(vz) < REST)
            & (abs(wx) < REST) & (abs(wy) < REST) & (abs(wz) < REST)
            & (abs(m0 - c0) < MOTORS_AT_REST) & (abs(m1 - c1) < MOTORS_AT_REST)
            & (abs(m2 - c2) < MOTORS_AT_REST) & (abs(m3 - c3) < MOTORS_AT_REST)
        )  # fmt: skip
        level = (
            (abs(px - plan[0][3]) < REST) & (abs(py - plan[1][3]) < REST)
            & (abs(pz - plan[2][3]) < REST)
            & (abs(qx) < REST) & (abs(qy) < REST) & (abs(qz) < REST)
        )  # fmt: skip
        calm = calm + 1.0 if still & (on_floor | level) else 0.0
    else:
        calm = 0.0
    return (standing, spin, calm, braking, hop, tx, ty, tz)


def control_period(
    state: State, command: Motors, plan: Plan, mode: FlightMode, air: Air, constants: Constants
) -> tuple[Motors, Plan, FlightMode, Air]:
    """Return the period's motor command and air, and plan and mode at its end."""
    _, gains, mixer, limits, weight, spin_up, weather = constants
    if mode[2] < PERIODS_TO_REST:
        if weather[4] > 0.0:
            air = wind.blow(air, weather)
        mode, kind = select_mode(state, plan, mode, limits)
        wanted = trajectory.setpoint_of(plan, limits)
        command = motor_commands(state, wanted, kind, weight, gains, mixer, air[6:9])
        plan, mode = next_leg(state[2], plan, mode, kind, spin_up, limits)
        mode = rest(state, command, plan, mode, limits)
    return command, plan, mode, air


def move(
    state: State, command: Motors, mode: FlightMode, flow: tuple[float, float, float], body: Body
) -> State:
    """Return the state one step later in air that moves with `flow`; at rest, the same."""
    if mode[2] < PERIODS_TO_REST:
        state = step(state, command, flow, body)
    return state


def fly(
    state: State,
    command: Motors,
    plan: Plan,
    mode: FlightMode,
    air: Air,
    constants: Constants,
    start: int,
    steps: int,
) -> tuple[State, Motors, Plan, FlightMode, Air]:
    """Return the vehicle after this many steps of 1 ms; every fourth is a control step.

    `start` counts the steps since boot. At rest a vehicle stays as it is.
    """
    body = constants[0]
    flow = air[0:3]
    if mode[2] < PERIODS_TO_REST:
        for count in range(start, start + steps):
            if count % STEPS == 0:
                command, plan, mode, air = control_period(
                    state, command, plan, mode, air, constants
                )
                flow = air[0:3]
            state = move(state, command, mode, flow, body)
    return state, command, plan, mode, air


SETTLED = 0.15
"""Share of the time to rest, 6 of 40 lags, after which the setpoint is all but at its stop."""
EVERY, LONGEST = 4, 25000
"""Control periods between the sampled points of a stop, and of the longest stop: 100 s."""


def widened(low: Point, high: Point, place: Point) -> tuple[Point, Point]:
    """Return a box, by its lowest and highest corner, extended to another point."""
    x, y, z = place
    lx, ly, lz = low
    hx, hy, hz = high
    return (
        (x if x < lx else lx, y if y < ly else ly, z if z < lz else lz),
        (x if x > hx else hx, y if y > hy else hy, z if z > hz else hz),
    )


def room(plan: Plan, mode: FlightMode, limits: Limits) -> tuple[Point, Point]:
    """Return the box, m, that the setpoint would stay in, with its lag, if it braked now."""
    low = place(plan, limits)
    high = low
    if plan[6] < limits[6]:
        plan, _ = brake(plan, mode, limits)
        # An axis that gains share on its way stops nearer.
        low, high = widened(low, high, (plan[0][3], plan[1][3], plan[2][3]))
        count = 0
        # A stop that turns round has been beyond its end. One that is not a number never rests.
        while (plan[6] < SETTLED * limits[6]) & (count < LONGEST):
            count = count + EVERY
            for _ in range(EVERY):
                plan = trajectory.advance(plan, limits)
            low, high = widened(low, high, place(plan, limits))
    return low, high
