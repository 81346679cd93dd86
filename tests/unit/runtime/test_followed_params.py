"""Two nodes whose parameters are judged together: each follows what the other has accepted."""

from typing import Any

import pytest

from quadctl.schemas.messages import Called
from quadctl.schemas.params import Params
from quadctl.schemas.services import SetParamsRequest, SetParamsResponse
from quadctl.schemas.topics import called, set_params
from quadctl.services.dynamics.__main__ import run as run_dynamics
from quadctl.services.runtime.followed_params import follow
from quadctl.services.runtime.params.live import LiveParams
from quadctl.services.runtime.testing import FakeNode
from quadctl.services.safety.__main__ import run as run_safety

OTHER = {"dynamics": "safety", "safety": "dynamics"}


def call(name: str, values: Any, *, success: bool = True) -> Called:
    service = set_params(name).name
    return Called("b", 0.0, service, False, {"values": values}, {"success": success}, "")


class Pair:
    """Nodes `dynamics` and `safety`, each with its own copy of all parameters."""

    def __init__(self) -> None:
        self.params = {name: Params() for name in OTHER}
        self.nodes = {name: FakeNode(name, self.params[name], [], []) for name in OTHER}
        self.changes: list[str] = []
        for name, other in OTHER.items():
            changed = lambda name=name: self.changes.append(name)  # noqa: E731
            follow(self.nodes[name], other, self.params[name], changed)  # type: ignore[arg-type]

    def set(self, **values: Any) -> SetParamsResponse:
        dotted = {name.replace("__", "."): value for name, value in values.items()}
        name = next(iter(dotted)).partition(".")[0]
        live = LiveParams(name, self.params[name], lambda _table: None, lambda: None)
        response = live.set(SetParamsRequest(dotted))
        self.tell(call(name, dotted, success=response.success), name)
        return response

    def tell(self, call: Called, name: str) -> None:
        self.nodes[OTHER[name]]._listeners[called(set_params(name)).name].take(call)


def test_each_node_judges_by_the_values_that_the_other_has_now():
    pair = Pair()
    assert pair.set(dynamics__control__max_speed=2.0).success
    assert pair.set(safety__max_speed=3.0).success
    reply = pair.set(dynamics__control__max_speed=5.0)
    assert (reply.success, "safety.max_speed: 3 m/s is less" in reply.reason) == (False, True)
    assert pair.changes == ["safety", "dynamics"]
    assert pair.params["safety"].dynamics.control.max_speed == 2.0


def test_a_guard_that_was_raised_is_not_in_the_way():
    pair = Pair()
    assert pair.set(safety__max_speed=30.0).success
    assert pair.set(dynamics__control__max_speed=15.0, dynamics__vehicle__drag=0.0).success
    assert pair.params["safety"].dynamics == pair.params["dynamics"].dynamics


def test_what_the_other_node_has_accepted_is_taken_without_another_verdict():
    """Both were accepted at once, each by the other's value of before."""
    pair = Pair()
    pair.tell(call("safety", {"safety.max_speed": 3.0}), "safety")
    pair.tell(call("dynamics", {"dynamics": {"control": {"max_speed": 8.0}}}), "dynamics")
    assert pair.params["dynamics"].safety.max_speed == 3.0
    assert pair.params["safety"].dynamics.control.max_speed == 8.0


def test_a_refused_change_is_not_followed():
    pair = Pair()
    pair.tell(call("safety", {"safety.max_speed": 3.0}, success=False), "safety")
    assert (pair.params["dynamics"], pair.changes) == (Params(), [])


@pytest.mark.parametrize(
    "values",
    [
        None, 3, {"safety": 3}, {"safety.max_speed": -1.0}, {"safety.max_speed.x": 1.0},
        {"safety.of_a_newer_version": 1.0},
    ],
    ids=str,
)  # fmt: skip
def test_values_that_cannot_be_followed_are_logged(values: Any, caplog: pytest.LogCaptureFixture):
    pair = Pair()
    pair.tell(call("safety", values), "safety")
    assert (pair.params["dynamics"], pair.changes) == (Params(), [])
    assert "safety" in caplog.text


@pytest.mark.parametrize(
    ("name", "run", "given"),
    [("dynamics", run_dynamics, "safety.max_speed"), ("safety", run_safety, "dynamics.grace")],
    ids=OTHER,
)
def test_the_process_of_each_follows_the_other(name: str, run: Any, given: str):
    """Its list of messages has a call that the other node has executed."""
    other, params = OTHER[name], Params()
    received = [(called(set_params(other)), call(other, {given: 7.0}))]
    node = FakeNode(name, params, received, [])
    run(node, params)
    assert 7.0 in (params.safety.max_speed, params.dynamics.grace)


def test_an_acceptance_range_is_judged_in_the_wind_that_blows():
    pair = Pair()
    assert pair.set(safety__acceptance_range=0.007).success
    # Nobody can refuse a wind.
    assert pair.set(dynamics__wind__gust=1.0).success
    assert pair.set(safety__takeoff=2.0).success
    reply = pair.set(safety__acceptance_range=0.008)
    assert (reply.success, "less than the vehicle can hold" in reply.reason) == (False, True)
    assert pair.set(safety__acceptance_range=0.5).success
