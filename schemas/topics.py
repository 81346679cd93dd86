"""Every key of the system, one entry each. Everything else is derived from these tables."""

from typing import Any

from schemas.contract import Service, Topic
from schemas.messages import Info, Pose, Pressure, SafetyState, Setpoint, Waypoint
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
