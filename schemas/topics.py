"""Every key of the system, one entry each. Everything else is derived from these tables."""

from typing import Any

from schemas.contract import Service, Topic
from schemas.messages import Called, Info, Pose, Pressure, SafetyState, Setpoint, Waypoint
from schemas.requests import (
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
