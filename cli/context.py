"""Common options, the vehicle that they select, and the connection to its hub."""

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from msgspec import Struct, structs

from quadctl.schemas.topics import Topic, topic_of
from quadctl.services.runtime.errors import Unreachable, UsageError
from quadctl.services.runtime.realm import default_name, listed, vehicle_name
from quadctl.services.runtime.vehicles import only_vehicle, vehicles_of

if TYPE_CHECKING:
    from quadctl.parameters import RunningParams
    from quadctl.schemas.keyexpr import EndpointInfo, Kind
    from quadctl.services.runtime.bus.client import Client


DEFAULT_TIMEOUT = 3.0
LONGEST_TIMEOUT = 86_400

COMMON: dict[str, tuple[type, str]] = {
    "realm": (str, "Name of the isolated run (env QUADCTL_REALM, default: default)."),
    "connect": (str, "A hub's Zenoh endpoint, e.g. tls/host:7447, instead of the realm's."),
    "identity": (str, "Folder of your identity on a network (env QUADCTL_IDENTITY)."),
    "vehicle": (str, "Name of the vehicle (env QUADCTL_VEHICLE, default: the only one)."),
    "timeout": (float, f"Seconds to wait for a reply (default: {DEFAULT_TIMEOUT:g})."),
    "json": (bool, "Machine-readable output."),
}


class Options(Struct, frozen=True):
    """Values of the common options; `named` is the vehicle that they name, or empty.

    `realm_given`: the command line itself names the realm.
    """

    realm: str
    connect: str
    named: str
    json: bool
    timeout: float
    realm_given: bool = False

    @property
    def vehicle(self) -> str:
        """Return the vehicle that is named, else the only one; raise as `only_vehicle` does."""
        return self.named or only_vehicle(self.realm, self.connect, self.timeout)

    @property
    def vehicles(self) -> list[str]:
        """Return all vehicles of the run of the selected vehicle, that vehicle included."""
        names = vehicles_of(self.realm, self.connect, self.timeout)
        return names if self.vehicle in names else [self.vehicle]


def require_local(options: Options, what: str) -> None:
    """Raise UsageError if the options name a hub: `what` needs this machine's processes."""
    if options.connect:
        raise UsageError(
            f"{what} needs the run's processes: --connect {options.connect} reaches only the bus",
            f"run it on that machine: `ssh HOST quadctl {what}`",
        )


def options_of(values: Mapping[str, Any]) -> Options:
    """Return the options by the line, the environment and the defaults; raise UsageError."""
    timeout = values.get("timeout", DEFAULT_TIMEOUT)
    named = values.get("vehicle") or os.environ.get("QUADCTL_VEHICLE")
    if not 0 < timeout <= LONGEST_TIMEOUT:
        hint = f"give seconds, more than 0, up to {LONGEST_TIMEOUT}"
        raise UsageError(f"--timeout {timeout:g}: not a time", hint)
    if folder := values.get("identity"):
        from quadctl.services.runtime.security.identity import choose

        choose(folder)
    return Options(
        realm=values.get("realm") or default_name(),
        connect=values.get("connect", ""),
        named=vehicle_name(named) if named else "",
        json=values.get("json", False),
        timeout=timeout,
        realm_given=bool(values.get("realm")),
    )


def connect(options: Options) -> "Client":
    """Connect to the hub that the options name; raise Unreachable if there is none."""
    # Imported here: a command without the bus starts in half the time.
    from quadctl.services.runtime.bus.client import Client

    return Client(options.realm, options.vehicle, connect=options.connect, timeout=options.timeout)


def listed_vehicles(options: Options) -> list[str]:
    """Return the vehicles that a listing shows: the named one, else all of the run."""
    return _vehicles(options) or [options.vehicle]


def listing(options: Options, *kinds: "Kind") -> "tuple[list[str], list[EndpointInfo]]":
    """Return the vehicles that a listing shows, and their endpoints of these kinds, by key."""
    vehicles = listed_vehicles(options)
    with connect(with_any_vehicle(options)) as client:
        found = client.endpoints(*kinds, of=vehicles[0] if len(vehicles) == 1 else "*")
    check_vehicle(options, found)
    return vehicles, [each for each in found if each.vehicle in vehicles]


def check_vehicle(options: Options, found: "Sequence[object]" = ()) -> None:
    """Raise Unreachable if the run lacks the vehicle that the options name, and none was `found`.

    A hub that has joined others also shows their vehicles, which are not in the run's record.
    """
    if found or not options.named:
        return
    names = vehicles_of(options.realm, options.connect, options.timeout)
    if names and options.named not in names:
        raise Unreachable(f"this run has no vehicle {options.named}", f"it has {listed(names)}")


@contextmanager
def running_params(options: Options) -> "Iterator[RunningParams]":
    """Connect for a vehicle's parameters; connection and calls together take at most --timeout."""
    from quadctl.parameters import RunningParams

    deadline = time.monotonic() + options.timeout
    with connect(options) as client:
        yield RunningParams(client, deadline)


def about_topic(options: Options, name: str) -> Options:
    """Return the options with the vehicle that a topic's full key names.

    For a pattern, or a key without a vehicle's name, any of several vehicles will do.
    """
    bare = name.strip("/")
    from quadctl.cli.names import is_relative  # every command that asks has it loaded

    if is_relative(bare):
        return options
    names = _vehicles(options)
    return _named(options, bare, names, names[0]) if len(names) > 1 else options


def own_topic(key: str, vehicle: str) -> Topic[Any] | None:
    """Return the vehicle's topic with a full key; None if the key belongs to anything else."""
    topic = topic_of(key)
    return topic if topic is not None and key == topic.key(vehicle) else None


def with_any_vehicle(options: Options) -> Options:
    """Return the options with one of the vehicles, for a request that any of them can make."""
    names = _vehicles(options)
    return structs.replace(options, named=names[0]) if names else options


def about_service(options: Options, name: str) -> Options:
    """Return the options with the vehicle that a service's full key names."""
    names = _vehicles(options)
    return _named(options, name.strip("/"), names, names[0] if len(names) == 1 else "")


def about_parameters(options: Options, words: list[str]) -> tuple[Options, list[str]]:
    """Return the options with the vehicle in `uav1.safety.takeoff`, and the words without it.

    `/uav1/safety/takeoff` is read the same way. A vehicle alone leaves an empty word, which means
    all its parameters. A `=` and a value may follow. Raises UsageError for several vehicles.
    """
    first = {_dotted(word)[0].partition(".")[0] for word in words}
    if not (named := first & set(_vehicles(options))):
        return options, words
    if len(first) > 1:
        raise UsageError(
            f"these belong to different vehicles: {', '.join(sorted(first))}",
            "ask about one vehicle's parameters at a time",
        )
    vehicle = named.pop()
    return structs.replace(options, named=vehicle), [
        name.removeprefix(vehicle).removeprefix(".") + value for name, value in map(_dotted, words)
    ]


def about_node(options: Options, name: str) -> tuple[Options, str]:
    """Return the options with the vehicle that `/uav1/safety` names, and the node's name alone."""
    vehicle, _, node = name.strip("/").partition("/")
    if not node or vehicle not in _vehicles(options):
        return options, name
    return structs.replace(options, named=vehicle), node


def _dotted(word: str) -> tuple[str, str]:
    """Split a word into a parameter's name, with dots for slashes, and `=` with its value."""
    name, equals, value = word.partition("=")
    return name.strip("/").replace("/", "."), f"{equals}{value}"


def _vehicles(options: Options) -> list[str]:
    if options.named:
        return [options.named]
    return vehicles_of(options.realm, options.connect, options.timeout)


def _named(options: Options, bare: str, names: list[str], otherwise: str) -> Options:
    first = bare.partition("/")[0]
    named = first if first in names else otherwise
    return structs.replace(options, named=named) if named else options
