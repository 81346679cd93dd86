"""Cascade control: position, velocity, attitude, body rates; yaw is held at 0.

Every error is taken against a setpoint that is smooth up to its snap. The setpoint's demand is fed
forward at each level: acceleration and drag as force, jerk as body rates, snap as torque. Feedback
only corrects gusts and other disturbances. The mean wind counts as known, as if estimated:
otherwise the vehicle would hover downwind of its setpoint.

World frame ENU, body frame FLU, SI units. Straight-line code, as in rigidbody.py.
"""

from math import sqrt, tan

from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics.rigidbody import STEP, State
from quadctl.services.dynamics.rotor import hover_speed

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
"""23 floats made by `control_constants`."""

Setpoint = tuple[float, ...]
"""15 floats: position, velocity, acceleration, jerk and led snap, each x, y, z, world frame."""


def lead(params: DynamicsParams) -> float:
    """Return the delay (s) from a command to its effect: the motors' lag and half a period."""
    return params.vehicle.motor_lag + 0.5 * PERIOD


def control_constants(params: DynamicsParams) -> Gains:
    """Return the parameters that `control` uses, in the order of use."""
    vehicle = params.vehicle
    gains = params.control
    inertia = vehicle.inertia
    wind = params.wind.mean
    # Rotor drag in hover: across the rotors for horizontal motion, along them for vertical.
    turning = 4.0 * hover_speed(vehicle) / vehicle.mass
    full = 4.0 * vehicle.thrust_coefficient * vehicle.max_motor_speed**2
    return (
        gains.position_gain,
        gains.max_speed,
        gains.velocity_gain,
        vehicle.drag / vehicle.mass,
        vehicle.gravity,
        LEAST_LIFT * vehicle.gravity + TINY,
        max(MOST_LIFT * full / vehicle.mass, LEAST_LIFT * vehicle.gravity + TINY),
        tan(gains.max_tilt),
        lead(params),
        vehicle.mass,
        gains.attitude_gain,
        gains.rate_gain,
        inertia.x,
        inertia.y,
        inertia.z,
        inertia.z - inertia.y,
        inertia.x - inertia.z,
        inertia.y - inertia.x,
        vehicle.linear_drag / vehicle.mass + turning * vehicle.rotor_drag.across,
        turning * (vehicle.rotor_drag.along - vehicle.rotor_drag.across),
        wind.x,
        wind.y,
        wind.z,
    )


# fmt: off
def specific_force(
    state: State, setpoint: Setpoint, gains: Gains
) -> tuple[float, float, float, float]:
    """Return the wanted thrust per mass (m/s^2, world), and 1, or 0 if its tilt is clamped.

    Position to velocity to acceleration. Drag is fed forward at the setpoint's velocity, not the
    vehicle's, so that it cannot feed on itself.
    """
    px, py, pz, vx, vy, vz, _, _, _, _, _, _, _, _, _, _, _ = state
    rx, ry, rz, sx, sy, sz, ax, ay, az, _, _, _, _, _, _ = setpoint
    (kp, fastest, kv, drag, g, least, most, tilt, _, _, _, _, _, _, _, _, _, _,
     linear, upward, ux, uy, uz) = gains
    # Only the correction is limited: the setpoint keeps its own speed limit.
    ex = kp * (rx - px)
    ey = kp * (ry - py)
    ez = kp * (rz - pz)
    n = sqrt(ex * ex + ey * ey + ez * ez + TINY)
    k = fastest / n if n > fastest else 1.0
    ux = sx - ux
    uy = sy - uy
    uz = sz - uz
    d = linear + drag * sqrt(ux * ux + uy * uy + uz * uz)
    fx = ax + kv * (k * ex + sx - vx) + d * ux
    fy = ay + kv * (k * ey + sy - vy) + d * uy
    fz = az + kv * (k * ez + sz - vz) + d * uz + upward * uz + g
    fz = least if fz < least else fz
    fz = most if fz > most else fz
    h = sqrt(fx * fx + fy * fy + TINY)
    k = fz * tilt / h if h > fz * tilt else 1.0
    return fx * k, fy * k, fz, 1.0 if k == 1.0 else 0.0


def control(
    state: State, setpoint: Setpoint, gains: Gains
) -> tuple[float, float, float, float]:
    """Return thrust (N, along body z) and torques (N m, body frame) to follow the setpoint.

    The attitude error is Lee, Leok and McClamroch's on SO(3) (CDC 2010), 0.5 (Rd^T R - R^T Rd);
    body rates and angular acceleration from jerk and snap follow Mellinger and Kumar (ICRA 2011).
    """
    _, _, _, _, _, _, qw, qx, qy, qz, wx, wy, wz, _, _, _, _ = state
    _, _, _, sx, sy, sz, ax, ay, az, jx, jy, jz, nx, ny, nz = setpoint
    (_, _, _, drag, _, _, _, _, ahead, mass, ka, kr, ix, iy, iz, gx, gy, gz,
     linear, _, ux, uy, uz) = gains
    fx, fy, fz, free = specific_force(state, setpoint, gains)
    f = 1.0 / sqrt(fx * fx + fy * fy + fz * fz)
    zx = fx * f
    zy = fy * f
    zz = fz * f
    # Snap and jerk of the specific force: the setpoint's plus drag's, without drag's minor terms.
    ux = sx - ux
    uy = sy - uy
    uz = sz - uz
    air = sqrt(ux * ux + uy * uy + uz * uz + TINY)
    d = linear + drag * air
    k = drag / air
    e = k * (ux * jx + uy * jy + uz * jz)
    nx = nx + d * jx + e * ux
    ny = ny + d * jy + e * uy
    nz = nz + d * jz + e * uz
    e = k * (ux * ax + uy * ay + uz * az)
    jx = jx + d * ax + e * ux
    jy = jy + d * ay + e * uy
    jz = jz + d * az + e * uz
    # First and second rate of the thrust's direction, across it; 0 while the tilt is clamped.
    k = f * free
    along = jx * zx + jy * zy + jz * zz
    ox = (jx - along * zx) * k
    oy = (jy - along * zy) * k
    oz = (jz - along * zz) * k
    along = 2.0 * along
    nx = (nx - along * ox) * k
    ny = (ny - along * oy) * k
    nz = (nz - along * oz) * k
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
    tx = 0.5 * ((zx * yx + zy * yy + zz * yz) - (by * ly + bz * lz))
    ty = 0.5 * ((mx * bx + my * by + mz * bz) - (xx * zx + xy * zy + xz * zz))
    tz = 0.5 * ((xy * ly + xz * lz) - (yx * mx + yy * my + yz * mz))
    # Attitude to body rates to torque.
    return (
        mass * ((fx + ahead * jx) * bx + (fy + ahead * jy) * by + (fz + ahead * jz) * bz),
        ix * (kr * (-ka * tx - (ox * yx + oy * yy + oz * yz) - wx) - (nx * yx + ny * yy + nz * yz))
        + gx * wy * wz,
        iy * (kr * (-ka * ty + (ox * xx + oy * xy + oz * xz) - wy) + (nx * xx + ny * xy + nz * xz))
        + gy * wx * wz,
        iz * (kr * (-ka * tz + k * (oy * mz - oz * my) - wz) + k * (ny * mz - nz * my))
        + gz * wx * wy,
    )
# fmt: on
