"""Vehicles behind the server: what the requests of its clients do."""

import contextlib
from collections.abc import Collection, Iterable

import msgspec
from msgspec import UNSET

from quadctl.schemas.topics import SERVICES
from quadctl.schemas.typed import from_json
from quadctl.services.bridges.base import AGE, BridgedVehicle
from quadctl.services.bridges.foxglove.protocol import FoxgloveParameter, Graph
from quadctl.services.bridges.foxglove.translation import by_node, request_of, to_ours
from quadctl.services.runtime.errors import Invalid, QuadctlError

_GOALS = "/goto"
"""Topic of published goals; of several vehicles each has its own, e.g. `/uav1/goto`."""


class Vehicles(dict[str, BridgedVehicle]):
    """Vehicles by name. All methods but `flown_by` block, and raise QuadctlError."""

    def call(self, service: str, payload: bytes) -> bytes:
        """Call a service of a vehicle, by its offered name, with JSON; return its response."""
        vehicle, _, name = service.partition("/")
        found = next(each for each in SERVICES if each.name == name)
        try:
            request = from_json(payload or b"{}", found.request)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            hint = f"`quadctl type show {name}` prints its fields"
            raise Invalid(f"not a valid request of {name}: {error}", hint) from error
        return msgspec.json.encode(self[vehicle].call(found, request))

    def flown_by(self, topic: str) -> BridgedVehicle:
        """Return the vehicle that flies to the goals of a topic; raise Invalid if none does."""
        vehicles = {f"/{name}{_GOALS}": vehicle for name, vehicle in self.items()}
        if len(vehicles) == 1:
            vehicles[_GOALS] = next(iter(vehicles.values()))
        if topic not in vehicles:
            raise Invalid(f"nobody takes {topic}", f"publish to one of {', '.join(vehicles)}")
        return vehicles[topic]

    def fly(self, topic: str, data: bytes) -> None:
        """Fly to a published goal."""
        vehicle = self.flown_by(topic)
        vehicle.fly(request_of(data, vehicle.height))

    def parameters(self, names: Collection[str]) -> list[FoxgloveParameter]:
        """Return the parameters with these names, all without any."""
        found = {
            f"{vehicle.name}.{name}": value
            for vehicle in tuple(self.values())
            for name, value in vehicle.parameters.read(AGE).items()
        }
        wanted = dict.fromkeys(names) or found
        return [FoxgloveParameter.of(name, found[name]) for name in wanted if name in found]

    def set_parameters(self, parameters: Iterable[FoxgloveParameter]) -> None:
        """Set parameters, of each node all or none; raise what the last node in vain raised."""
        problem: QuadctlError | None = None
        given = {each.name: each.value for each in parameters}
        if missing := [name for name, value in given.items() if value is UNSET]:
            raise Invalid(f"{missing[0]} has no value", "a parameter cannot be removed")
        for (vehicle, _), changes in by_node(given).items():
            try:
                if vehicle not in self:
                    raise Invalid(f"there is no vehicle {vehicle}", f"one of {', '.join(self)}")
                ours = self[vehicle].parameters
                present = ours.read()
                ours.set({name: to_ours(each, present.get(name)) for name, each in changes.items()})
            except QuadctlError as refusal:
                problem = refusal
        if problem:
            raise problem

    def graph(self) -> Graph:
        """Return the present connection graph."""
        endpoints = []
        for vehicle in tuple(self.values()):
            with contextlib.suppress(QuadctlError):
                endpoints += vehicle.node.endpoints()
        return Graph.of(endpoints)
