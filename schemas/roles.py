"""Rights of each role: the table behind the hub's access control.

A role is given for named vehicles or for all (`*`). Keys stand without the vehicle, which comes before
them. Everything not listed is denied; a new topic or service is for operators alone until it is
listed for others.

A user's own needs no line here: topics below `VEHICLE/own/`, services below `VEHICLE/@srv/own/`,
nodes named `own-NAME`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from quadctl.schemas.keyexpr import includes
from quadctl.schemas.topics import (
    CALIBRATE,
    GOTO,
    HOLD,
    INFO,
    RESET,
    SERVICES,
    TOPICS,
    Service,
    called,
    get_params,
    set_params,
)

Role = Literal["hub", "vehicle", "safety", "operator", "observer", "student"]
Right = Literal["publish", "listen", "call", "read", "serve", "announce", "see"]
"""`read` is to ask for a latched topic's last message, `see` to be told which nodes are there, and
`announce` to be one of them."""

EVERY = "*"
"""All vehicles."""
ROUTERS = ("hub", "gate")
"""The nodes of a run that are no part of the vehicle itself."""

_OFFERS = ("", "/@pub/**", "/@srv/**")
_OWN = "own/**"
_OWN_SERVICES = "@srv/own/**"
_OWN_NODES = (
    "@node/own-$*",
    # Who says that he offers what is another's would keep that one from starting.
    "@node/own-$*/@pub/*/*/*/$*%own%$*",
    "@node/own-$*/@srv/*/*/*/$*%@srv%own%$*",
)
_RECORDERS = "@node/recorder-$*"
"""Who records is a node, and offers nothing."""
_NODES = sorted({entry.node for table in (TOPICS, SERVICES) for entry in table if entry.node})
_LATCHED = tuple(topic.name for topic in TOPICS if topic.latched)
_ANYONES = tuple(topic.name for topic in TOPICS if not topic.node)
"""What is published by whoever wants to: requests."""

Rights = Mapping[Right, tuple[str, ...]]


def _services(*nodes: str) -> list[Service[Any, Any]]:
    own: list[Service[Any, Any]] = [service for service in SERVICES if service.node in nodes]
    return [*own, *(of(node) for node in nodes for of in (get_params, set_params))]


def _name(service: Service[Any, Any]) -> str:
    return f"@srv/{service.name}"


def _runs(*nodes: str) -> Rights:
    """What the processes of these nodes do."""
    services = _services(*nodes)
    topics = [topic.name for topic in TOPICS if topic.node in nodes]
    told = [called(service).name for service in services if not service.reads]
    latched = [topic.name for topic in TOPICS if topic.node in nodes and topic.latched]
    return {
        "publish": (*topics, *told, _OWN),
        "serve": (*map(_name, services), *latched, _OWN, _OWN_SERVICES),
        **_WATCHES,
        "announce": (*(f"@node/{n}{o}" for n in nodes for o in _OFFERS), *_OWN_NODES, _RECORDERS),
    }


_WATCHES: Rights = {
    "listen": ("**", "@call/**"),
    "read": (*_LATCHED, _OWN),
    "see": tuple(f"@node/*{offer}" for offer in _OFFERS),
    "announce": (_RECORDERS,),
}
_FLIES: Rights = {
    "publish": (*_ANYONES, _OWN),
    "serve": (_OWN, _OWN_SERVICES),
    **_WATCHES,
    "announce": (*_OWN_NODES, _RECORDERS),
}
_ALL = ("**", "@call/**", "@srv/**")
_ALL_NODES = ("@node/**", *(f"@node/*{offer}" for offer in _OFFERS))

ROLES: dict[Role, Rights] = {
    # Another hub, with all who are behind it.
    "hub": {
        "publish": _ALL,
        "listen": _ALL,
        "call": _ALL,
        "read": _ALL,
        "serve": _ALL,
        "announce": _ALL_NODES,
        "see": _ALL_NODES,
    },
    # A machine that runs the vehicle's nodes, but not the one that says where to fly.
    "vehicle": _runs(*(node for node in _NODES if node != "safety")),
    # The only one that writes setpoints.
    "safety": _runs("safety"),
    "operator": {"call": ("@srv/**",), **_FLIES},
    "observer": _WATCHES,
    # Flies, and touches neither the cage nor any parameter.
    "student": {
        "call": (
            *(_name(service) for service in (GOTO, HOLD, CALIBRATE, RESET)),
            *(_name(get_params(node)) for node in (*ROUTERS, *_NODES)),
            _OWN_SERVICES,
        ),
        **_FLIES,
    },
}

PUBLIC: Rights = {
    "read": (f"*/{INFO.name}",),
    "see": tuple(f"*/@node/{router}" for router in ROUTERS),
}
"""What every role may do with every vehicle, in full keys: who is denied something can know that the
system is there."""


def keys(role: Role, vehicles: Sequence[str], right: Right) -> list[str]:
    """The key expressions that somebody of a role has a right to, for his vehicles."""
    names = ROLES[role].get(right, ())
    own = [_full(vehicle, name) for vehicle in vehicles for name in names]
    return [*own, *PUBLIC.get(right, ())]


def may(role: Role, vehicles: Sequence[str], right: Right, key: str) -> bool:
    """Whether somebody of a role may do that with a key, or with all that an expression covers."""
    return any(includes(pattern, key) for pattern in keys(role, vehicles, right))


def _full(vehicle: str, name: str) -> str:
    # Of all vehicles, `**` covers also what somebody asks of everything.
    return name if (vehicle, name) == (EVERY, "**") else f"{vehicle}/{name}"
