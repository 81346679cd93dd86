"""Moving air: a steady wind, and gusts that are the same in every flight with the same seed.

Gusts follow Dryden's spectrum along the wind (MIL-F-8785C), here on all three axes: white noise
through a first-order lag. The mean wind and its own turbulence carry a gust past the vehicle, so
its time constant is the length scale over the speed of both. Dryden's gusts have no bound; these end
at four times their RMS, as those that services/airspace/airworthiness.py counts with.

The controller knows a steady wind. It knows gusts with a lag, as if it computed them from the difference
between measured and expected acceleration, as incremental controllers do (Smeur, de Croon and Chu,
Control Engineering Practice 2018).

The noise must be bit-identical in plain Python and compiled. Three multiplicative generators with
different moduli use whole numbers below 2^53, which floats hold exactly. A draw is the sum of their
three uniform numbers (Irwin and Hall's distribution); the lag turns it into a normal one. Their
combined period is far beyond any fleet's need.

World frame ENU, SI units. Straight-line code, as in rigidbody.py.
"""

from math import exp, sqrt

from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics.controller import PERIOD

Air = tuple[float, float, float, float, float, float, float, float, float]
"""The air's velocity (m/s, world), the three generators' states, whole numbers, and the velocity that
the controller estimates."""

Weather = tuple[float, float, float, float, float, float]
"""Mean wind (m/s, world), share of a gust that is left after a control period, RMS of the noise added
then (m/s, 0 without gusts), and the greatest speed of a gust, m/s."""

_MOST = 4.0
"""Greatest speed of a gust in any direction, over the RMS on each axis."""

A1, M1 = 48271.0, 2147483647.0
"""Park, Miller and Stockmeyer's generator (CACM 1993)."""
A2, M2 = 40014.0, 2147483563.0
A3, M3 = 40692.0, 2147483399.0
"""L'Ecuyer's two (CACM 1988)."""

WHOLE = 6755399441055744.0
"""1.5 * 2^52: adding and subtracting it rounds to the nearest whole number."""

ESTIMATE_LAG = 0.1
"""Lag of the estimated air behind the true one, s."""
LEARNT = 1.0 - exp(-PERIOD / ESTIMATE_LAG)
"""Share of the difference between them that a control period takes away."""

_MASK = 2**64 - 1


def weather_of(params: DynamicsParams) -> Weather:
    """Return the parameters that `blow` uses."""
    wind = params.wind
    mean = wind.mean
    speed = sqrt(mean.x**2 + mean.y**2 + mean.z**2 + wind.gust**2)
    keep = exp(-PERIOD * speed / wind.gust_length)
    noise_rms = wind.gust * sqrt(1.0 - keep * keep)
    return (mean.x, mean.y, mean.z, keep, noise_rms, _MOST * wind.gust)


def initial_air(params: DynamicsParams) -> Air:
    """Return the air at boot, in the middle of a gust that differs from seed to seed."""
    mean, gust = params.wind.mean, params.wind.gust
    s1, s2, s3 = (
        1.0 + _scattered(3 * params.seed + i) % int(m - 1.0) for i, m in enumerate((M1, M2, M3))
    )
    nx, s1, s2, s3 = noise(s1, s2, s3)
    ny, s1, s2, s3 = noise(s1, s2, s3)
    nz, s1, s2, s3 = noise(s1, s2, s3)
    gx, gy, gz = bounded(gust * nx, gust * ny, gust * nz, _MOST * gust)
    ux, uy, uz = mean.x + gx, mean.y + gy, mean.z + gz
    return (ux, uy, uz, s1, s2, s3, ux, uy, uz)


def changed(air: Air, weather: Weather) -> Air:
    """Return the air under new parameters: gusts continue, a steady wind changes at once."""
    _, _, _, s1, s2, s3, _, _, _ = air
    wx, wy, wz, _, stir, _ = weather
    return air if stir > 0.0 else (wx, wy, wz, s1, s2, s3, wx, wy, wz)


def follower(s: float, a: float, m: float) -> float:
    """Return a generator's state after `s`: a s mod m, between 1 and m - 1."""
    s = a * s
    s = s - m * ((s / m + WHOLE) - WHOLE)
    return s if s > 0.0 else s + m


def noise(s1: float, s2: float, s3: float) -> tuple[float, float, float, float]:
    """Return a number of mean 0 and variance 1, between -3 and 3, and the generators' states."""
    s1 = follower(s1, A1, M1)
    s2 = follower(s2, A2, M2)
    s3 = follower(s3, A3, M3)
    return 2.0 * (s1 / M1 + s2 / M2 + s3 / M3) - 3.0, s1, s2, s3


def blow(air: Air, weather: Weather) -> Air:
    """Return the air one control period later."""
    ux, uy, uz, s1, s2, s3, ex, ey, ez = air
    wx, wy, wz, keep, stir, most = weather
    # The acceleration tells of the air until now, not of the next period.
    ex = ex + LEARNT * (ux - ex)
    ey = ey + LEARNT * (uy - ey)
    ez = ez + LEARNT * (uz - ez)
    nx, s1, s2, s3 = noise(s1, s2, s3)
    ny, s1, s2, s3 = noise(s1, s2, s3)
    nz, s1, s2, s3 = noise(s1, s2, s3)
    gx, gy, gz = bounded(
        keep * (ux - wx) + stir * nx,
        keep * (uy - wy) + stir * ny,
        keep * (uz - wz) + stir * nz,
        most,
    )
    return wx + gx, wy + gy, wz + gz, s1, s2, s3, ex, ey, ez


def bounded(gx: float, gy: float, gz: float, most: float) -> tuple[float, float, float]:
    """Return a gust (m/s) in its direction, of a greatest speed, m/s."""
    speed = sqrt(gx * gx + gy * gy + gz * gz)
    share = most / speed if speed > most else 1.0
    return share * gx, share * gy, share * gz


def _scattered(seed: int) -> int:
    """Return 64 bits that are unrelated for neighbouring seeds (SplitMix64)."""
    x = (seed + 1) * 0x9E3779B97F4A7C15 & _MASK
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9 & _MASK
    x = (x ^ x >> 27) * 0x94D049BB133111EB & _MASK
    return x ^ x >> 31
