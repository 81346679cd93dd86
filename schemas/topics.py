"""Topic, Service and the two tables TOPICS and SERVICES."""

import math
from typing import Any, Generic, TypeVar

from msgspec import Struct

from quadctl.schemas.messages import (
    Called,
    Info,
    Pose,
    Poses,
    Pressure,
    SafetyState,
    Setpoint,
    Waypoint,
    Zones,
)
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
    """Return the number of a rate's period at a time (s), despite rounding at its start."""
    return math.floor(stamp * hz + 1e-6)


class Topic(Generic[M]):
    """Key that one process publishes on and any process may subscribe to.

    `hz` is the declared rate, 0 for messages on events only. A latched topic answers `get` on its
    own key with the last message.
    """

    def __init__(
        self, name: str, type_: type[M], *, node: str, hz: float, doc: str, latched: bool = False
    ) -> None:
        self.name, self.type, self.node = name, type_, node
        self.hz, self.doc, self.latched = hz, doc, latched

    def __repr__(self) -> str:
        return f"<topic {self.name}: {self.type.__name__}>"

    def key(self, vehicle: str) -> str:
        """Return the Zenoh key, e.g. `uav/sensors/pressure`."""
        return f"{vehicle}/{self.name}"

    def period(self, stamp: float) -> int:
        """Return the number of the declared rate's period at a simulated time (s)."""
        return period(stamp, self.hz)

    def begins(self, stamp: float, step: float) -> bool:
        """Return whether a period begins at a simulated time (s), one step (s) after the time before."""
        return self.period(stamp) != self.period(stamp - step)


class Service(Generic[Q, R]):
    """Request and response, on a key that one process answers.

    With `reads` it changes nothing, and its calls are not published.
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

    def __repr__(self) -> str:
        return f"<service {self.name}: {self.type_name}>"

    @property
    def type_name(self) -> str:
        """Return the pair's name, e.g. `Calibrate` for CalibrateRequest and CalibrateResponse."""
        return self.request.__name__.removesuffix("Request")

    def key(self, vehicle: str) -> str:
        """Return the Zenoh key, e.g. `uav/@srv/goto`; wildcards do not match the chunk `@srv`."""
        return f"{vehicle}/@srv/{self.name}"


POSE = Topic("pose", Pose, node="dynamics", hz=100, doc="True pose of the vehicle.")
POSE_SLOW = Topic(
    "pose/slow", Pose, node="dynamics", hz=20, doc="The poses that safety answers, every fifth."
)
POSES = Topic(
    "@all/pose", Poses, node="dynamics", hz=20, doc="All poses up to one that safety answers."
)
"""In lock-step, the messages of POSE for those that need each of them: at full speed one wake for those of
several answers. Wildcards do not match the chunk `@all`."""
PRESSURE = Topic(
    "sensors/pressure", Pressure, node="pressure", hz=10, doc="Barometer, baseline subtracted."
)
STATE = Topic(
    "safety/state", SafetyState, node="safety", hz=1, doc="The automaton's state.", latched=True
)
REQUEST = Topic(
    "input/position_request", Waypoint, node="", hz=0, doc="Requested waypoint, without an answer."
)
SETPOINT = Topic("input/position", Setpoint, node="safety", hz=20, doc="The verified setpoint.")
ZONES = Topic("safety/zones", Zones, node="safety", hz=0, doc="Zones that bar ways.", latched=True)

INFO = Topic("info", Info, node="safety", hz=0, doc="Nodes by service and topic.", latched=True)

_CALLS = "@call/"
"""Chunk that wildcards do not match: a subscriber to `**` does not receive calls."""

TOPICS: tuple[Topic[Any], ...] = (
    POSE, POSE_SLOW, PRESSURE, STATE, ZONES, REQUEST, SETPOINT, INFO,
)  # fmt: skip
MESSAGES: dict[str, type[Struct]] = {topic.type.__name__: topic.type for topic in TOPICS}
"""Types of the topics' messages, by name."""

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
    """Return the service that reads a node's parameters; every node has one."""
    return Service(
        f"{node}/get_params",
        GetParamsRequest,
        GetParamsResponse,
        node=node,
        doc=f"Read the parameters of {node}.",
        reads=True,
    )


def set_params(node: str) -> Service[SetParamsRequest, SetParamsResponse]:
    """Return the service that changes a node's parameters, all or none."""
    return Service(
        f"{node}/set_params",
        SetParamsRequest,
        SetParamsResponse,
        node=node,
        doc=f"Change the parameters of {node}.",
    )


def own_service(name: str) -> Service[Any, Any]:
    """Return a service `own/NAME`, which has types of its author's: its messages are plain tables."""
    return Service(name, dict, dict, node="", doc="A service of its author's own.")


def called(service: Service[Any, Any]) -> Topic[Called]:
    """Return the topic of executed calls of a service that may change something."""
    return Topic(
        f"{_CALLS}{service.name}",
        Called,
        node=service.node,
        hz=0,
        doc=f"Executed calls of {service.name}.",
    )


def topic_of(key: str) -> Topic[Any] | None:
    """Return the topic of a full key, for any vehicle."""
    _, _, name = key.partition("/")
    if name.startswith(_CALLS):
        return Topic(name, Called, node="", hz=0, doc="Executed calls.")
    return next((topic for topic in TOPICS if topic.name == name), None)
