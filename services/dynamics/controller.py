"""Cascade control: position, velocity, attitude, body rates; yaw is held at 0.

Every error is taken against a setpoint that is smooth up to its snap. The setpoint's demand is fed
forward at each level: acceleration and drag as force, jerk as body rates, snap and crackle as
torque. Feedback only corrects other disturbances. The wind counts as known, as wind.py describes:
otherwise the vehicle would hover downwind of its setpoint.

World frame ENU, body frame FLU, SI units. Straight-line code, as in rigidbody.py.
"""

from math import sqrt, tan

from quadctl.schemas.params import DynamicsParams
from quadctl.services.airspace.airworthiness import delay, held_tilt
from quadctl.services.dynamics.rigidbody import STEP, State

STEPS = 4
"""Integration steps per control period: 250 Hz."""
PERIOD = STEPS * STEP
"""Control period, s."""
LEAST_LIFT = 0.2
"""Least vertical specific force, g: with none there is no force to tilt."""
MOST_LIFT = 0.9
"""Share of the full thrust that the vertical may take; the rest is for roll and pitch."""
TINY = 1e-12
"""Added under a root that is a divisor: above 0, and far below any value that matters."""

Gains = tuple[float, ...]
"""21 floats made by `control_constants`."""

Wind = tuple[float, float, float]
"""Velocity of the air, m/s, world frame."""

Setpoint = tuple[float, ...]
"""18 floats: position, velocity, acceleration, jerk, snap and crackle, each x, y, z, world frame."""


def control_constants(params: DynamicsParams) -> Gains:
    """Return the parameters that `control` uses, in the order of use."""
    vehicle = params.vehicle
    gains = params.control
    inertia = vehicle.inertia
    full = 4.0 * vehicle.thrust_coefficient * vehicle.max_motor_speed**2
    # Of each torque about x and y, Euler's equations take a part of the product of two body rates;
    # the thrust's direction, which turns with the body, takes another.
    return (
        gains.position_gain,
        gains.max_speed,
        gains.velocity_gain,
        vehicle.drag / vehicle.mass,
        vehicle.gravity,
        LEAST_LIFT * vehicle.gravity + TINY,
        max(MOST_LIFT * full / vehicle.mass, LEAST_LIFT * vehicle.gravity + TINY),
        tan(held_tilt(vehicle, gains)),
        delay(vehicle),
        vehicle.mass,
        gains.attitude_gain,
        gains.rate_gain,
        inertia.x,
        inertia.y,
        inertia.z,
        inertia.x + inertia.z - inertia.y,
        inertia.x - inertia.z - inertia.y,
        inertia.y - inertia.x,
        vehicle.linear_drag / vehicle.mass,
        vehicle.rotor_drag.across / vehicle.mass,
        vehicle.rotor_drag.across - vehicle.rotor_drag.along,
    )


# fmt: off
def specific_force(
    state: State, setpoint: Setpoint, gains: Gains, air: Wind
) -> tuple[float, float, float, float]:
    """Return the wanted thrust per mass (m/s^2, world), and 1, or 0 if its tilt is clamped.

    Position to velocity to acceleration. Drag is fed forward at the setpoint's velocity, not the
    vehicle's, so that it cannot feed on itself.
    """
    px, py, pz, vx, vy, vz, _, _, _, _, _, _, _, m0, m1, m2, m3 = state
    rx, ry, rz, sx, sy, sz, ax, ay, az, _, _, _, _, _, _, _, _, _ = setpoint
    (kp, fastest, kv, drag, g, least, most, tilt, _, _, _, _, _, _, _, _, _, _,
     linear, across, _) = gains
    ux, uy, uz = air
    # Only the correction is limited: the setpoint keeps its own speed limit.
    ex = kp * (rx - px)
    ey = kp * (ry - py)
    ez = kp * (rz - pz)
    n = sqrt(ex * ex + ey * ey + ez * ez + TINY)
    k = fastest / n if n > fastest else 1.0
    ux = sx - ux
    uy = sy - uy
    uz = sz - uz
    d = linear + across * (m0 + m1 + m2 + m3) + drag * sqrt(ux * ux + uy * uy + uz * uz)
    fx = ax + kv * (k * ex + sx - vx) + d * ux
    fy = ay + kv * (k * ey + sy - vy) + d * uy
    fz = az + kv * (k * ez + sz - vz) + d * uz + g
    fz = least if fz < least else fz
    fz = most if fz > most else fz
    h = sqrt(fx * fx + fy * fy + TINY)
    k = fz * tilt / h if h > fz * tilt else 1.0
    return fx * k, fy * k, fz, 1.0 if k == 1.0 else 0.0


def specific_force_rates(
    state: State,
    setpoint: Setpoint,
    gains: Gains,
    air: Wind,
    force: tuple[float, float, float, float],
) -> tuple[float, float, float, float, float, float]:
    """Return the first and second rate of the setpoint's specific force, with those of drag.

    Drag is d u, with u the speed through the air and d = linear + drag |u|; its rotors' part goes
    with their speed, and that with the root of the force.
    """
    fx, fy, fz, _ = force
    _, _, _, _, _, _, _, _, _, _, _, _, _, m0, m1, m2, m3 = state
    _, _, _, sx, sy, sz, ax, ay, az, jx, jy, jz, nx, ny, nz, _, _, _ = setpoint
    (_, _, _, drag, _, _, _, _, _, _, _, _, _, _, _, _, _, _,
     linear, across, _) = gains
    ux, uy, uz = air
    ux = sx - ux
    uy = sy - uy
    uz = sz - uz
    n = sqrt(ux * ux + uy * uy + uz * uz + TINY)
    m = across * (m0 + m1 + m2 + m3)
    d = linear + m + drag * n
    # First and second rate of n; r and q, those of the root of the force, in roots; then of d.
    e = (ux * ax + uy * ay + uz * az) / n
    k = (ux * jx + uy * jy + uz * jz + ax * ax + ay * ay + az * az - e * e) / n
    f = 1.0 / (fx * fx + fy * fy + fz * fz)
    r = 0.5 * f * (fx * jx + fy * jy + fz * jz)
    q = 0.5 * f * (fx * nx + fy * ny + fz * nz + jx * jx + jy * jy + jz * jz) - 3.0 * r * r
    e = drag * e + m * r
    k = drag * k + m * q
    return (
        jx + d * ax + e * ux,
        jy + d * ay + e * uy,
        jz + d * az + e * uz,
        nx + d * jx + 2.0 * e * ax + k * ux,
        ny + d * jy + 2.0 * e * ay + k * uy,
        nz + d * jz + 2.0 * e * az + k * uz,
    )


def direction_rates(
    force: tuple[float, float, float, float],
    rates: tuple[float, float, float, float, float, float],
    setpoint: Setpoint,
    ahead: float,
) -> tuple[float, float, float, float, float, float]:
    """Return the first and the led second rate of the thrust's direction z, across it.

    They follow from those of the force f = |f| z, and are 0 while its tilt is clamped. The torque
    lags by `ahead` (s) behind its command, so the third rate leads the second.
    """
    fx, fy, fz, free = force
    jx, jy, jz, nx, ny, nz = rates
    _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, cx, cy, cz = setpoint
    f = 1.0 / sqrt(fx * fx + fy * fy + fz * fz)
    zx = fx * f
    zy = fy * f
    zz = fz * f
    k = f * free
    e = (jx * zx + jy * zy + jz * zz) * f
    ox = jx * k - e * free * zx
    oy = jy * k - e * free * zy
    oz = jz * k - e * free * zz
    n = (nx * zx + ny * zy + nz * zz) * f
    nx = nx * k - n * free * zx - 2.0 * e * ox
    ny = ny * k - n * free * zy - 2.0 * e * oy
    nz = nz * k - n * free * zz - 2.0 * e * oz
    c = (cx * zx + cy * zy + cz * zz) * f
    # Less one |z'|^2 z', as the body's axes turn with z.
    n = 3.0 * n + 2.0 * (ox * ox + oy * oy + oz * oz)
    e = 3.0 * e
    return (
        ox,
        oy,
        oz,
        nx + ahead * (cx * k - c * free * zx - e * nx - n * ox),
        ny + ahead * (cy * k - c * free * zy - e * ny - n * oy),
        nz + ahead * (cz * k - c * free * zz - e * nz - n * oz),
    )


def control(
    state: State, setpoint: Setpoint, gains: Gains, air: Wind
) -> tuple[float, float, float, float]:
    """Return thrust (N, along body z) and torques (N m, body frame) to follow the setpoint.

    `air` is the air's velocity as it is known, m/s, world.

    The attitude error is that of the thrust's direction, z_b x z_d (Brescianini, Hehn and D'Andrea,
    2013), and of the yaw; so a vehicle that yaws flies on. Body rates and angular acceleration from
    jerk and snap follow Mellinger and Kumar (ICRA 2011). Thrust lags as the torque does, and is led
    by the jerk.
    """
    _, _, _, _, _, _, qw, qx, qy, qz, wx, wy, wz, m0, m1, m2, m3 = state
    _, _, _, sx, sy, sz, ax, ay, az, _, _, _, _, _, _, _, _, _ = setpoint
    (_, _, _, _, _, _, _, _, ahead, mass, ka, kr, ix, iy, iz, gx, gy, gz,
     _, _, axial) = gains
    ux, uy, uz = air
    force = specific_force(state, setpoint, gains, air)
    rates = specific_force_rates(state, setpoint, gains, air, force)
    ox, oy, oz, nx, ny, nz = direction_rates(force, rates, setpoint, ahead)
    fx, fy, fz, _ = force
    jx, jy, jz, _, _, _ = rates
    f = 1.0 / sqrt(fx * fx + fy * fy + fz * fz)
    zx = fx * f
    zy = fy * f
    zz = fz * f
    # Columns of the true attitude, then of the wanted one: z along the force, y level (yaw 0).
    xx = 1.0 - 2.0 * (qy * qy + qz * qz)
    xy = 2.0 * (qx * qy + qw * qz)
    xz = 2.0 * (qx * qz - qw * qy)
    yx = 2.0 * (qx * qy - qw * qz)
    yy = 1.0 - 2.0 * (qx * qx + qz * qz)
    yz = 2.0 * (qy * qz + qw * qx)
    bx = 2.0 * (qx * qz + qw * qy)
    by = 2.0 * (qy * qz - qw * qx)
    bz = 1.0 - 2.0 * (qx * qx + qy * qy)
    k = 1.0 / sqrt(zy * zy + zz * zz)
    ly = zz * k
    lz = -zy * k
    mx = ly * zz - lz * zy
    my = lz * zx
    mz = -ly * zx
    tx = zx * yx + zy * yy + zz * yz
    ty = -(xx * zx + xy * zy + xz * zz)
    tz = 0.5 * ((xy * ly + xz * lz) - (yx * mx + yy * my + yz * mz))
    # Air that streams along the rotors' axes changes their lift: e per sum of their speeds.
    ux = sx - ux
    uy = sy - uy
    uz = sz - uz
    e = ux * bx + uy * by + uz * bz
    r = 0.5 * f * (zx * jx + zy * jy + zz * jz)
    e = e + ahead * (r * e + ax * bx + ay * by + az * bz + ux * ox + uy * oy + uz * oz)
    # Attitude to body rates to torque.
    return (
        mass * ((fx + ahead * jx) * bx + (fy + ahead * jy) * by + (fz + ahead * jz) * bz)
        - axial * (m0 + m1 + m2 + m3) * e,
        ix * (kr * (-ka * tx - (ox * yx + oy * yy + oz * yz) - wx) - (nx * yx + ny * yy + nz * yz))
        + gx * wy * wz,
        iy * (kr * (-ka * ty + (ox * xx + oy * xy + oz * xz) - wy) + (nx * xx + ny * xy + nz * xz))
        + gy * wx * wz,
        iz * (kr * (-ka * tz + k * (oy * mz - oz * my) - wz) + k * (ny * mz - nz * my))
        + gz * wx * wy,
    )
# fmt: on
