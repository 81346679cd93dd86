"""Places on the earth and in our world."""

from math import cos, dist, nan, radians, sin, sqrt

import pytest
from hypothesis import given, strategies as st

from quadctl.schemas.earth import Origin, origin_of

near = st.floats(-100, 100)
origins = st.builds(Origin, st.floats(-60, 60), st.floats(-180, 180), st.floats(-100, 4000))


def earth_fixed(latitude: float, longitude: float, height: float) -> tuple[float, float, float]:
    """Return a place in the earth's own frame, m, by the ellipsoid's definition."""
    a, f = 6_378_137.0, 1 / 298.257223563
    phi, lam = radians(latitude), radians(longitude)
    n = a / sqrt(1 - f * (2 - f) * sin(phi) ** 2)
    r = (n + height) * cos(phi)
    return r * cos(lam), r * sin(lam), (n * (1 - f) ** 2 + height) * sin(phi)


@given(origins, near, near)
def test_a_place_comes_back_to_a_centimetre(origin: Origin, x: float, y: float):
    assert dist(origin.to_world(*origin.to_earth(x, y)), (x, y)) < 0.011


@given(origins, near, near)
def test_degrees_are_those_of_the_ellipsoid(origin: Origin, x: float, y: float):
    latitude, longitude = origin.to_earth(x, y)
    here = earth_fixed(origin.latitude, origin.longitude, 0)
    there = earth_fixed(latitude / 1e7, longitude / 1e7, 0)
    delta = [b - a for a, b in zip(here, there, strict=True)]
    phi, lam = radians(origin.latitude), radians(origin.longitude)
    east = -sin(lam) * delta[0] + cos(lam) * delta[1]
    north = -sin(phi) * (cos(lam) * delta[0] + sin(lam) * delta[1]) + cos(phi) * delta[2]
    assert dist((east, north), (x, y)) < 0.015


def test_a_world_across_the_date_line_is_one():
    origin = Origin(-17.0, 179.9999, 0.0)
    latitude, longitude = origin.to_earth(50.0, 0.0)
    assert longitude < 0
    assert dist(origin.to_world(latitude, longitude), (50, 0)) < 0.02


def test_an_origin_has_three_numbers_or_none():
    assert origin_of(()) == Origin()
    assert origin_of((-33.9, 151.2, 20.0)) == Origin(-33.9, 151.2, 20.0)


@pytest.mark.parametrize("numbers", [(90, 0, 0), (0, 181, 0), (0, 0, nan), (0, 0, 20_000)])
def test_an_origin_off_the_earth_is_refused(numbers: tuple[float, float, float]):
    with pytest.raises(ValueError, match=r"^(latitude|longitude|altitude) "):
        origin_of(numbers)
