"""Catalogue of faults: each sets an existing parameter and is reported while active."""

import msgspec
import pytest

from quadctl.cli.fault.catalogue import FAULTS, Fault, active
from quadctl.schemas.params import Params
from quadctl.services.runtime.params.names import flatten

DEFAULTS = dict(flatten(msgspec.to_builtins(Params())))


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_cleared_fault_has_its_parameter_at_the_default(fault: Fault):
    assert DEFAULTS[fault.parameter] == fault.sound
    assert fault.parameter.startswith(f"{fault.node}.")
    msgspec.convert(_nested(fault.parameter, fault.value), Params)
    assert active(DEFAULTS | {fault.parameter: fault.value}) == [fault.name]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_size_comes_with_its_fault_and_goes_with_it(fault: Fault):
    if not fault.size:
        assert fault.values(None) == {fault.parameter: fault.value}
        assert fault.cleared(DEFAULTS) == {fault.parameter: fault.sound}
        return
    sized = fault.values(0.75)
    assert sized[fault.size] == 0.75
    assert "SIZE" in fault.about
    assert active(DEFAULTS | sized) == [fault.name]
    assert active(DEFAULTS | fault.values(None)) == [fault.name]
    launched = DEFAULTS | ({} if fault.size == fault.parameter else {fault.size: 0.25})
    assert launched | sized | fault.cleared(launched) == launched


def test_no_fault_is_active_by_default_and_small_numbers_count():
    assert active(DEFAULTS) == active({}) == []
    assert active(DEFAULTS | {"dynamics.wind.gust": 0.1}) == ["gust"]


def _nested(name: str, value: object) -> dict[str, object]:
    first, _, rest = name.partition(".")
    return {first: _nested(rest, value) if rest else value}
