"""Values, descriptions and listings of parameters as ROS has them."""

import pytest
from hypothesis import given, strategies as st

from quadctl.services.bridges.ros2 import parameters
from quadctl.services.runtime.params.catalogue import leaves

SCALARS = (
    st.booleans(),
    st.integers(-(2**63) + 1, 2**63 - 1),
    st.floats(allow_nan=False),
    st.text(),
)
NAMES = ("safety.takeoff", "safety.virtual_cage.x", "dynamics.rate")


@given(st.one_of(*SCALARS, *(st.lists(each, min_size=1) for each in SCALARS)))
def test_a_value_comes_back_as_it_was(plain):
    assert parameters.to_ours(parameters.to_ros(plain), plain) == plain


@pytest.mark.parametrize("plain", [[], [1, "a"], [{"name": "tower"}], {"x": 1.0}, [[1.0, 2.0]]])
def test_what_ros_cannot_hold_is_text_in_tomls_notation(plain):
    found = parameters.to_ros(plain)
    assert found.type == 4
    assert parameters.to_ours(found, plain) == plain


def test_no_value_is_none_and_so_refused():
    assert parameters.to_ours(parameters._value(), 1.0) is None
    unknown = parameters._value()
    unknown.type = 99
    assert parameters.to_ours(unknown, 1.0) is None


def test_every_parameter_can_be_described():
    for name, entry in leaves().items():
        found = parameters.described(name, entry.default, entry)
        assert found.name == name
        assert found.description
    assert parameters.described("mine.gain", 1.0, None).type == 3


def test_a_half_open_interval_is_text():
    entry = leaves()["safety.acceptance_range"]
    found = parameters.described(entry.name, 0.5, entry)
    assert not found.floating_point_range
    assert found.additional_constraints.startswith("(0")


@pytest.mark.parametrize(
    ("prefixes", "depth", "names"),
    [
        ((), 0, ["dynamics.rate", "safety.takeoff", "safety.virtual_cage.x"]),
        ((), 2, ["dynamics.rate", "safety.takeoff"]),
        (("safety",), 0, ["safety.takeoff", "safety.virtual_cage.x"]),
        (("safety",), 1, ["safety.takeoff"]),
        (("safety.takeoff",), 1, ["safety.takeoff"]),
        (("saf",), 0, []),
    ],
)
def test_a_listing_has_what_is_below_its_prefixes(prefixes, depth, names):
    assert list(parameters.listed(NAMES, prefixes, depth).names) == names
