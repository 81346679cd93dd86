"""The common options, the vehicle that they mean, and the connection to its hub."""

import os
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from msgspec import Struct, structs

from quadctl.schemas.topics import TOPICS, Topic, topic_of
from quadctl.services.runtime import run_files
from quadctl.services.runtime.errors import Unreachable, UsageError
from quadctl.services.runtime.realm import (
    DEFAULT,
    HUB_ALONE,
    Realm,
    default_name,
    listed,
    vehicle_name,
)

if TYPE_CHECKING:
    from quadctl.services.runtime.bus.client import Client


def the_only(realm: str, connect: str, timeout: float) -> str:
    """The vehicle of a run that has one, `uav` where nothing runs; of a hub, where one is named.

    Raises UsageError where there are several, and over `connect` what a Client does (timeout in s).
    """
    there = vehicles_of(realm, connect, timeout)
    if len(there) > 1 and DEFAULT not in there:
        raise UsageError(
            f"there are several vehicles: {listed(there)}",
            f"say which: --vehicle {there[0]}, or set QUADCTL_VEHICLE",
        )
    return there[0] if len(there) == 1 else DEFAULT


def vehicles_of(realm: str, connect: str, timeout: float) -> list[str]:
    """The vehicles of a run, or of a hub where one is named; raises as `the_only` over that."""
    if connect:
        return _at(realm, connect, timeout)
    # At a hub alone, those of others that have joined it.
    return _at(realm, "", timeout) if hub_alone(realm) else _in(realm)


def in_run(realm: str) -> list[str]:
    """The vehicles of a run, as its record has them; none where nothing runs."""
    return [name for name in _in(realm) if not name.startswith(HUB_ALONE)]


def hub_alone(realm: str) -> str:
    """What the hub of a run without a vehicle goes by; empty where there is a vehicle, or no run."""
    there = _in(realm)
    return there[0] if there and there[0].startswith(HUB_ALONE) else ""


def _in(realm: str) -> list[str]:
    try:
        return run_files.read(Realm(realm)).vehicles
    except (Unreachable, UsageError):
        # Told by whoever needs the run, or the realm's name.
        return []


@lru_cache
def _at(realm: str, connect: str, timeout: float) -> list[str]:
    from quadctl.services.runtime.bus.client import Client
    from quadctl.services.runtime.security.endpoints import is_secure

    if is_secure(connect):
        from quadctl.services.runtime.security.identity import needed

        # Who may see one vehicle means that one.
        if (ours := needed(connect).name.vehicles) != ["*"]:
            return ours
    with Client(realm, DEFAULT, connect=connect, timeout=timeout) as client:
        return client.vehicles()


DEFAULT_TIMEOUT = 3.0
LONGEST_TIMEOUT = 86_400

COMMON: dict[str, tuple[type, str]] = {
    "realm": (str, "Name of the isolated run (env QUADCTL_REALM, default: default)."),
    "connect": (str, "A hub's Zenoh endpoint, as tls/host:7447, instead of the realm's."),
    "identity": (str, "Who you are on a network: a folder (env QUADCTL_IDENTITY)."),
    "vehicle": (str, "Whose keys are meant (env QUADCTL_VEHICLE, default: the only one)."),
    "timeout": (float, f"Seconds to wait for a reply (default: {DEFAULT_TIMEOUT:g})."),
    "json": (bool, "Machine-readable output."),
}


class Options(Struct, frozen=True):
    """What the common options say; `named` is the vehicle that they name, or empty."""

    realm: str
    connect: str
    named: str
    json: bool
    timeout: float

    @property
    def vehicle(self) -> str:
        """The vehicle meant: the one named, else the only one there is.

        Raises UsageError where there are several.
        """
        return self.named or the_only(self.realm, self.connect, self.timeout)

    @property
    def vehicles(self) -> list[str]:
        """All vehicles of the run that the one meant belongs to, itself among them."""
        there = vehicles_of(self.realm, self.connect, self.timeout)
        return there if self.vehicle in there else [self.vehicle]


def here(options: Options, what: str) -> None:
    """Raise UsageError where the options name a hub: `what` is about this machine's processes."""
    if options.connect:
        raise UsageError(
            f"{what} is about the processes of this machine, and --connect {options.connect} about"
            " the bus alone",
            f"on the machine itself: `ssh HOST quadctl {what}`",
        )


def options_of(said: Mapping[str, Any]) -> Options:
    """From what the line says, the environment, and the defaults; raises UsageError."""
    timeout = said.get("timeout", DEFAULT_TIMEOUT)
    named = said.get("vehicle") or os.environ.get("QUADCTL_VEHICLE")
    if not 0 < timeout <= LONGEST_TIMEOUT:
        raise UsageError(
            f"--timeout {timeout:g}: not a time",
            f"give seconds, more than 0, up to {LONGEST_TIMEOUT}",
        )
    if folder := said.get("identity"):
        from quadctl.services.runtime.security.identity import choose

        choose(folder)
    return Options(
        realm=said.get("realm") or default_name(),
        connect=said.get("connect", ""),
        named=vehicle_name(named) if named else "",
        json=said.get("json", False),
        timeout=timeout,
    )


def connect(options: Options) -> "Client":
    """Connect to the hub that the options name; raises Unreachable when there is none."""
    # Imported here: a line that needs no bus is read in half the time.
    from quadctl.services.runtime.bus.client import Client

    return Client(options.realm, options.vehicle, connect=options.connect, timeout=options.timeout)


def about_topic(options: Options, name: str) -> Options:
    """The options, with the vehicle that a topic's full key names.

    For a key that is nobody's, or a pattern, it does not matter which of several vehicles asks.
    """
    bare = name.strip("/")
    if any(topic.name == bare for topic in TOPICS):
        return options
    there = _there(options)
    return _named(options, bare, there, there[0]) if len(there) > 1 else options


def own_topic(key: str, vehicle: str) -> Topic[Any] | None:
    """The topic of the vehicle that has a full key; None where the key is anybody else's."""
    topic = topic_of(key)
    return topic if topic is not None and key == topic.key(vehicle) else None


def anyone(options: Options) -> Options:
    """The options, with one of the vehicles where it does not matter which asks."""
    there = _there(options)
    return structs.replace(options, named=there[0]) if there else options


def about_service(options: Options, name: str) -> Options:
    """The options, with the vehicle that a service's full key names."""
    return _named(options, name.strip("/"), _there(options), "")


def about_parameters(options: Options, words: list[str]) -> tuple[Options, list[str]]:
    """The options with the vehicle that `uav1.safety.takeoff` names, and the words without it.

    So it is with `/uav1/safety/takeoff`; of a vehicle alone nothing is left, which is all that it
    has. A value may follow behind a `=`. Raises UsageError where the words name several.
    """
    first = {_dotted(word)[0].partition(".")[0] for word in words}
    if not (named := first & set(_there(options))):
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
    """The options with the vehicle that `/uav1/safety` names, and the node's own name."""
    vehicle, _, node = name.strip("/").partition("/")
    if not node or vehicle not in _there(options):
        return options, name
    return structs.replace(options, named=vehicle), node


def _dotted(word: str) -> tuple[str, str]:
    """A parameter's name with dots for slashes, and its value with the `=` before it."""
    name, equals, value = word.partition("=")
    return name.strip("/").replace("/", "."), f"{equals}{value}"


def _there(options: Options) -> list[str]:
    if options.named:
        return [options.named]
    return vehicles_of(options.realm, options.connect, options.timeout)


def _named(options: Options, bare: str, there: list[str], otherwise: str) -> Options:
    first = bare.partition("/")[0]
    named = first if first in there else otherwise
    return structs.replace(options, named=named) if named else options
