"""Rigid body with four rotors: equations of motion and one Runge-Kutta step.

World frame ENU, body frame FLU, SI units. The state is one flat tuple of 17 floats, in order:
position (m, world), velocity (m/s, world), quaternion w, x, y, z (body to world), body rates
(rad/s, body) and motor speeds (rad/s). Rotors, seen from above: front left, rear left, rear right,
front right; the first and third push the body to yaw left, the others right.

The functions are straight-line code over floats, so that the same source can be compiled: a branch
is a conditional expression, or a single `if` that saves work. Callers loop over steps.
"""

from math import exp, sqrt

from quadctl.schemas.vehicle import VehicleParams

STEP = 0.001
"""Integration step, s."""

State = tuple[float, ...]
"""17 floats, see the module's docstring."""

Motors = tuple[float, float, float, float]
"""Motor speeds or their commands, rad/s."""

Body = tuple[float, ...]
"""18 floats made by `body_constants`."""


def body_constants(vehicle: VehicleParams, step: float = STEP) -> Body:
    """Return the parameters and the step size (s) that one step uses, in the order of use."""
    inertia = vehicle.inertia
    return (
        vehicle.thrust_coefficient,
        vehicle.torque_coefficient,
        vehicle.arm / sqrt(2.0) * vehicle.thrust_coefficient,
        vehicle.drag / vehicle.mass,
        vehicle.linear_drag / vehicle.mass,
        vehicle.rotor_drag.across / vehicle.mass,
        vehicle.rotor_drag.along / vehicle.mass,
        1.0 / vehicle.mass,
        vehicle.gravity,
        inertia.z - inertia.y,
        inertia.x - inertia.z,
        inertia.y - inertia.x,
        1.0 / inertia.x,
        1.0 / inertia.y,
        1.0 / inertia.z,
        exp(-0.5 * step / vehicle.motor_lag),
        exp(-step / vehicle.motor_lag),
        step,
    )


# fmt: off
def derivative(
    vx: float, vy: float, vz: float, qw: float, qx: float, qy: float, qz: float,
    wx: float, wy: float, wz: float, m0: float, m1: float, m2: float, m3: float,
    ux: float, uy: float, uz: float, body: Body,
) -> tuple[float, float, float, float, float, float, float, float, float, float]:
    """Return the rates of velocity, quaternion and body rates; position's is the velocity.

    Newton and Euler's equations with the gyroscopic term. Thrust k w^2 acts along body z. The air
    moves with u (m/s, world). Drag on the body goes with |v - u| (v - u) and v - u; drag on the
    rotors with the sum of their speeds times v - u, across and along body z.
    """
    kf, km, kl, drag, linear, across, along, im, g, gx, gy, gz, ix, iy, iz, _, _, _ = body
    s0 = m0 * m0
    s1 = m1 * m1
    s2 = m2 * m2
    s3 = m3 * m3
    left = s0 + s1
    right = s2 + s3
    lift = kf * (left + right) * im
    ax = vx - ux
    ay = vy - uy
    az = vz - uz
    k = linear + drag * sqrt(ax * ax + ay * ay + az * az)
    zx = 2.0 * (qx * qz + qw * qy)
    zy = 2.0 * (qy * qz - qw * qx)
    zz = 1.0 - 2.0 * (qx * qx + qy * qy)
    if across + along > 0.0:
        m = m0 + m1 + m2 + m3
        k = k + across * m
        lift = lift + (across - along) * m * (zx * ax + zy * ay + zz * az)
    return (
        zx * lift - k * ax,
        zy * lift - k * ay,
        zz * lift - k * az - g,
        0.5 * (-qx * wx - qy * wy - qz * wz),
        0.5 * (qw * wx + qy * wz - qz * wy),
        0.5 * (qw * wy - qx * wz + qz * wx),
        0.5 * (qw * wz + qx * wy - qy * wx),
        (kl * (left - right) - gx * wy * wz) * ix,
        (kl * ((s1 + s2) - (s0 + s3)) - gy * wx * wz) * iy,
        (km * ((s0 + s2) - (s1 + s3)) - gz * wx * wy) * iz,
    )


def step(
    state: State, command: Motors, wind: tuple[float, float, float], body: Body
) -> State:
    """Return the state one step later, by the classical Runge-Kutta method of order four.

    The motors follow `command` by the exact first-order lag, m = c + (m - c) exp(-t / lag), which
    gives their speeds at the midpoint and the end. `wind` is the air's velocity, m/s, world. The
    quaternion is normalised. A vehicle below the floor, z = 0, is put on it: level, with no body
    rates and no velocity but upwards.
    """
    px, py, pz, vx, vy, vz, qw, qx, qy, qz, wx, wy, wz, m0, m1, m2, m3 = state
    c0, c1, c2, c3 = command
    ux, uy, uz = wind
    half_decay = body[15]
    decay = body[16]
    h = body[17]
    d0 = m0 - c0
    d1 = m1 - c1
    d2 = m2 - c2
    d3 = m3 - c3
    n0 = c0 + d0 * half_decay
    n1 = c1 + d1 * half_decay
    n2 = c2 + d2 * half_decay
    n3 = c3 + d3 * half_decay
    e0 = c0 + d0 * decay
    e1 = c1 + d1 * decay
    e2 = c2 + d2 * decay
    e3 = c3 + d3 * decay
    t = 0.5 * h
    a3, a4, a5, a6, a7, a8, a9, aa, ab, ac = derivative(
        vx, vy, vz, qw, qx, qy, qz, wx, wy, wz, m0, m1, m2, m3, ux, uy, uz, body)
    v1x = vx + t * a3
    v1y = vy + t * a4
    v1z = vz + t * a5
    b3, b4, b5, b6, b7, b8, b9, ba, bb, bc = derivative(
        v1x, v1y, v1z, qw + t * a6, qx + t * a7, qy + t * a8, qz + t * a9,
        wx + t * aa, wy + t * ab, wz + t * ac, n0, n1, n2, n3, ux, uy, uz, body)
    v2x = vx + t * b3
    v2y = vy + t * b4
    v2z = vz + t * b5
    f3, f4, f5, f6, f7, f8, f9, fa, fb, fc = derivative(
        v2x, v2y, v2z, qw + t * b6, qx + t * b7, qy + t * b8, qz + t * b9,
        wx + t * ba, wy + t * bb, wz + t * bc, n0, n1, n2, n3, ux, uy, uz, body)
    v3x = vx + h * f3
    v3y = vy + h * f4
    v3z = vz + h * f5
    g3, g4, g5, g6, g7, g8, g9, ga, gb, gc = derivative(
        v3x, v3y, v3z, qw + h * f6, qx + h * f7, qy + h * f8, qz + h * f9,
        wx + h * fa, wy + h * fb, wz + h * fc, e0, e1, e2, e3, ux, uy, uz, body)
    k = h / 6.0
    px = px + k * ((vx + v3x) + 2.0 * (v1x + v2x))
    py = py + k * ((vy + v3y) + 2.0 * (v1y + v2y))
    pz = pz + k * ((vz + v3z) + 2.0 * (v1z + v2z))
    vx = vx + k * ((a3 + g3) + 2.0 * (b3 + f3))
    vy = vy + k * ((a4 + g4) + 2.0 * (b4 + f4))
    vz = vz + k * ((a5 + g5) + 2.0 * (b5 + f5))
    qw = qw + k * ((a6 + g6) + 2.0 * (b6 + f6))
    qx = qx + k * ((a7 + g7) + 2.0 * (b7 + f7))
    qy = qy + k * ((a8 + g8) + 2.0 * (b8 + f8))
    qz = qz + k * ((a9 + g9) + 2.0 * (b9 + f9))
    wx = wx + k * ((aa + ga) + 2.0 * (ba + fa))
    wy = wy + k * ((ab + gb) + 2.0 * (bb + fb))
    wz = wz + k * ((ac + gc) + 2.0 * (bc + fc))
    # Contact is one factor for five components; adding 0.0 turns -0.0 into 0.0. The legs stand level,
    # unless the vehicle lies on its back.
    free = 0.0 if pz < 0.0 else 1.0
    stands = (pz < 0.0) & (qw * qw + qz * qz > 0.25)
    unit = 1.0 / sqrt(
        qw * qw + (0.0 if stands else qx * qx) + (0.0 if stands else qy * qy) + qz * qz
    )
    return (
        px, py, pz if pz > 0.0 else 0.0,
        vx * free + 0.0, vy * free + 0.0, 0.0 if (pz < 0.0) & (vz <= 0.0) else vz,
        qw * unit, 0.0 if stands else qx * unit, 0.0 if stands else qy * unit, qz * unit,
        wx * free + 0.0, wy * free + 0.0, wz * free + 0.0, e0, e1, e2, e3,
    )
# fmt: on
