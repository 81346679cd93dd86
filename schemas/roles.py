"""Rights of each role: the table behind the hub's access control.

A role is given for named vehicles or for all (`*`). Keys are written without the vehicle, their
first chunk. Everything not listed is denied; a new topic or service is open to operators only.

A user's own endpoints need no line here: topics below `VEHICLE/own/`, services below
`VEHICLE/@srv/own/`, nodes named `own-NAME`.
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
"""`read` queries a latched topic's last message, `see` receives the liveliness of nodes, and
`announce` declares a node."""

EVERY = "*"
"""All vehicles."""
ROUTERS = ("hub", "gate")
"""Nodes of a run that are not part of the vehicle."""
BRIDGES = ("foxglove", "mavlink", "ros2")
"""Nodes that connect a vehicle to other networks, with the rights of the one who starts them."""

_OFFERS = ("", "/@pub/**", "/@srv/**", "/@sub/**")
_OWN = "own/**"
_OWN_SERVICES = "@srv/own/**"
_OWN_NODES = (
    "@node/own-$*",
    # A declaration of another node's endpoint would keep that node from starting.
    "@node/own-$*/@pub/*/*/*/$*%own%$*",
    "@node/own-$*/@srv/*/*/*/$*%@srv%own%$*",
    "@node/own-$*/@sub/**",
)
_RECORDERS = "@node/recorder-$*"
"""A recorder is a node without endpoints."""
_BRIDGE_NODES = tuple(f"@node/{name}{offer}" for name in BRIDGES for offer in _OFFERS)
_NODES = sorted({entry.node for table in (TOPICS, SERVICES) for entry in table if entry.node})
_LATCHED = tuple(topic.name for topic in TOPICS if topic.latched)
_ANYONES = tuple(topic.name for topic in TOPICS if not topic.node)
"""Topics that any process publishes: requests."""

Rights = Mapping[Right, tuple[str, ...]]


def _services(*nodes: str) -> list[Service[Any, Any]]:
    own: list[Service[Any, Any]] = [service for service in SERVICES if service.node in nodes]
    return [*own, *(of(node) for node in nodes for of in (get_params, set_params))]


def _name(service: Service[Any, Any]) -> str:
    return f"@srv/{service.name}"


def _runs(*nodes: str) -> Rights:
    """Return the rights of the processes of these nodes."""
    services = _services(*nodes)
    topics = [topic.name for topic in TOPICS if topic.node in nodes]
    calls = [called(service).name for service in services if not service.reads]
    latched = [topic.name for topic in TOPICS if topic.node in nodes and topic.latched]
    return {
        "publish": (*topics, *calls, _OWN),
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
    "serve": (
        _OWN,
        _OWN_SERVICES,
        *(_name(of(name)) for name in BRIDGES for of in (get_params, set_params)),
    ),
    **_WATCHES,
    "announce": (*_OWN_NODES, *_BRIDGE_NODES, _RECORDERS),
}
_READS_PARAMS = tuple(_name(get_params(node)) for node in (*ROUTERS, *_NODES))
_ALL = ("**", "@call/**", "@srv/**")
_ALL_NODES = ("@node/**", *(f"@node/*{offer}" for offer in _OFFERS))

ROLES: dict[Role, Rights] = {
    # Another hub, with all its clients.
    "hub": {
        "publish": _ALL,
        "listen": _ALL,
        "call": _ALL,
        "read": _ALL,
        "serve": _ALL,
        "announce": _ALL_NODES,
        "see": _ALL_NODES,
    },
    # A machine with the vehicle's nodes, except safety, which sends the setpoints.
    "vehicle": _runs(*(node for node in _NODES if node != "safety")),
    # The only role that writes setpoints.
    "safety": _runs("safety"),
    "operator": {"call": ("@srv/**",), **_FLIES},
    "observer": _WATCHES,
    # May fly, but change neither the cage nor any parameter.
    "student": {
        "call": (
            *(_name(service) for service in (GOTO, HOLD, CALIBRATE, RESET)),
            *_READS_PARAMS,
            _OWN_SERVICES,
        ),
        **_FLIES,
    },
}

PUBLIC: Rights = {
    "read": (f"*/{INFO.name}",),
    "see": tuple(f"*/@node/{router}" for router in ROUTERS),
}
"""Rights of every role for every vehicle, in full keys: a client without other rights can still see
that the system is there."""


def rights_of(node: str) -> Rights:
    """Return the rights of a node alone: to offer what it offers, and to watch and read all else."""
    return {**_runs(node), "call": (*_READS_PARAMS, _OWN_SERVICES)}


def keys(role: Role, vehicles: Sequence[str], right: Right) -> list[str]:
    """Return the key expressions that a role has a right to, for its vehicles."""
    return patterns(ROLES[role], vehicles, right)


def patterns(rights: Rights, vehicles: Sequence[str], right: Right) -> list[str]:
    """Return the key expressions of one right, for the vehicles of its holder."""
    names = rights.get(right, ())
    # For all vehicles, `**` alone also permits a subscription to everything.
    own = [
        name if (vehicle, name) == (EVERY, "**") else f"{vehicle}/{name}"
        for vehicle in vehicles
        for name in names
    ]
    return [*own, *PUBLIC.get(right, ())]


def may(role: Role, vehicles: Sequence[str], right: Right, key: str) -> bool:
    """Return whether a role has a right to a key, or to all keys of an expression."""
    return any(includes(pattern, key) for pattern in keys(role, vehicles, right))


def node_may(node: str, right: Right, key: str) -> bool:
    """Return whether a node that has the rights of its name alone has a right to a key."""
    return any(includes(pattern, key) for pattern in patterns(rights_of(node), [EVERY], right))
