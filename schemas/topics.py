"""Topic, Service and the two tables TOPICS and SERVICES."""

import math
from typing import Any, Generic, TypeVar

from msgspec import Struct

from quadctl.schemas.messages import Called, Info, Pose, Pressure, SafetyState, Setpoint, Waypoint
from quadctl.schemas.services import (
    CalibrateRequest,
    CalibrateResponse,
    GetParamsRequest,
    GetParamsResponse,
    GotoRequest,
    GotoResponse,
    HoldRequest,
    HoldResponse,
    ResetRequest,
    ResetResponse,
    SetParamsRequest,
    SetParamsResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)

M = TypeVar("M", bound=Struct)
Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)


def period(stamp: float, hz: float) -> int:
    """Which period of a rate a time (s) falls in.

    The slack takes up the rounding of stamps that meet a boundary.
    """
    return math.floor(stamp * hz + 1e-6)


class Topic(Generic[M]):
    """A key that one process publishes on and any process may listen to.

    `hz` is the declared rate, 0 where messages come only when something happens. A latched
    topic answers `get` on its own key with the last message.
    """

    def __init__(
        self, name: str, type_: type[M], *, node: str, hz: float, doc: str, latched: bool = False
    ) -> None:
        self.name, self.type, self.node = name, type_, node
        self.hz, self.doc, self.latched = hz, doc, latched

    def key(self, vehicle: str) -> str:
        """The Zenoh key, as `uav/sensors/pressure`."""
        return f"{vehicle}/{self.name}"

    def period(self, stamp: float) -> int:
        """Which period of the declared rate a simulated time (s) falls in."""
        return period(stamp, self.hz)


class Service(Generic[Q, R]):
    """A request and its response, on a key that one process answers.

    One that only `reads` changes nothing, and nobody is told of its calls.
    """

    def __init__(
        self,
        name: str,
        request: type[Q],
        response: type[R],
        *,
        node: str,
        doc: str,
        reads: bool = False,
    ) -> None:
        self.name, self.request, self.response = name, request, response
        self.node, self.doc, self.reads = node, doc, reads

    @property
    def type_name(self) -> str:
        """The pair's name, as `Calibrate` for CalibrateRequest and CalibrateResponse."""
        return self.request.__name__.removesuffix("Request")

    def key(self, vehicle: str) -> str:
        """The Zenoh key, as `uav/@srv/goto`; `@srv` is a chunk that wildcards do not match."""
        return f"{vehicle}/@srv/{self.name}"


POSE = Topic("pose", Pose, node="dynamics", hz=100, doc="True pose of the vehicle.")
PRESSURE = Topic(
    "sensors/pressure", Pressure, node="pressure", hz=10, doc="Barometer, baseline subtracted."
)
STATE = Topic(
    "safety/state", SafetyState, node="safety", hz=1, doc="The automaton's state.", latched=True
)
REQUEST = Topic(
    "input/position_request", Waypoint, node="", hz=0, doc="A waypoint asked for, unanswered."
)
SETPOINT = Topic("input/position", Setpoint, node="safety", hz=20, doc="The verified setpoint.")

INFO = Topic("info", Info, node="safety", hz=0, doc="Who serves what.", latched=True)

_CALLS = "@call/"
"""A chunk that wildcards do not match: who listens to everything is not told of calls as well."""

TOPICS: tuple[Topic[Any], ...] = (POSE, PRESSURE, STATE, REQUEST, SETPOINT, INFO)

CALIBRATE = Service(
    "calibrate_pressure",
    CalibrateRequest,
    CalibrateResponse,
    node="pressure",
    doc="Zero the barometer here.",
)
TOGGLE_CAGE = Service(
    "toggle_cage",
    ToggleCageRequest,
    ToggleCageResponse,
    node="safety",
    doc="Turn the virtual cage on or off.",
)
GOTO = Service("goto", GotoRequest, GotoResponse, node="safety", doc="Fly to a verified point.")
HOLD = Service("hold", HoldRequest, HoldResponse, node="safety", doc="Stop and hover.")
RESET = Service(
    "reset", ResetRequest, ResetResponse, node="dynamics", doc="Back to the start, a new boot."
)

SERVICES: tuple[Service[Any, Any], ...] = (CALIBRATE, TOGGLE_CAGE, GOTO, HOLD, RESET)


def get_params(node: str) -> Service[GetParamsRequest, GetParamsResponse]:
    """The service that reads a node's parameters; every node has one."""
    return Service(
        f"{node}/get_params",
        GetParamsRequest,
        GetParamsResponse,
        node=node,
        doc=f"Read the parameters of {node}.",
        reads=True,
    )


def set_params(node: str) -> Service[SetParamsRequest, SetParamsResponse]:
    """The service that changes a node's parameters, all or none."""
    return Service(
        f"{node}/set_params",
        SetParamsRequest,
        SetParamsResponse,
        node=node,
        doc=f"Change the parameters of {node}.",
    )


def called(service: Service[Any, Any]) -> Topic[Called]:
    """What tells of every executed call of a service that may change something."""
    return Topic(
        f"{_CALLS}{service.name}",
        Called,
        node=service.node,
        hz=0,
        doc=f"The calls of {service.name}, as they were executed.",
    )


def topic_of(key: str) -> Topic[Any] | None:
    """The topic that a full key belongs to, whatever the vehicle."""
    _, _, name = key.partition("/")
    if name.startswith(_CALLS):
        return Topic(name, Called, node="", hz=0, doc="Calls, as they were executed.")
    return next((topic for topic in TOPICS if topic.name == name), None)
