"""Parameters of a vehicle's nodes as a bridge reads and sets them, with services of the test."""

from collections.abc import Callable
from typing import Any

import pytest
from msgspec import Struct

from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.schemas.services import GetParamsRequest, GetParamsResponse, SetParamsResponse
from quadctl.schemas.topics import Service
from quadctl.services.runtime.errors import Invalid, Refused, TimedOut
from quadctl.services.runtime.params.remote import RemoteParams

VALUES = {"meter": {"meter.scale": 2.5}, "safety": {"safety.takeoff": 1.0}, "slow": {}}


class Vehicle:
    """Nodes `safety`, `meter` of a user, and `slow`, which does not answer."""

    def __init__(self) -> None:
        self.is_lost = False
        self.set_by: list[str] = []
        self.reads = 0
        self.meanwhile: Callable[[], None] = lambda: None
        self.parameters = RemoteParams(self._call, self._endpoints)

    def _endpoints(self) -> list[EndpointInfo]:
        if self.is_lost:
            raise TimedOut("the hub did not answer")
        offers = [*((node, "GetParams") for node in VALUES), ("camera", "Shoot")]
        return [EndpointInfo("uav", "@srv", *offer, "", 0.0, "uav/@srv/x") for offer in offers]

    def _call(self, service: Service[Any, Any], request: Struct) -> Any:
        if service.node == "slow":
            raise TimedOut("slow did not answer")
        if isinstance(request, GetParamsRequest):
            self.reads += service.node == "meter"
            self.meanwhile()
            return GetParamsResponse(VALUES[service.node])
        self.set_by.append(service.node)
        return SetParamsResponse(success=service.node != "safety", reason="there is no such one")


def test_every_live_node_that_answers_is_read_the_labs_first():
    assert list(Vehicle().parameters.read()) == ["safety.takeoff", "meter.scale"]


def test_parameters_are_read_again_if_one_was_set_while_they_were_read():
    vehicle = Vehicle()
    vehicle.parameters.read(age=60.0)
    vehicle.parameters.read(age=60.0)
    assert vehicle.reads == 1
    vehicle.parameters.forget()
    vehicle.meanwhile = vehicle.parameters.forget
    vehicle.parameters.read(age=60.0)
    vehicle.meanwhile = lambda: None
    vehicle.parameters.read(age=60.0)
    vehicle.parameters.read(age=60.0)
    assert vehicle.reads == 3


def test_without_a_hub_there_are_none():
    vehicle = Vehicle()
    vehicle.is_lost = True
    assert vehicle.parameters.read() == {}


def test_a_users_own_node_sets_its_own_and_safety_refuses_an_unknown_one():
    vehicle = Vehicle()
    vehicle.parameters.set({"meter.scale": 3.0})
    with pytest.raises(Refused):
        vehicle.parameters.set({"nobody.scale": 3.0})
    assert vehicle.set_by == ["meter", "safety"]
    with pytest.raises(Invalid, match="several nodes"):
        vehicle.parameters.set({"meter.scale": 3.0, "safety.takeoff": 1.0})
