"""The options that every command has, declared once and understood at any place in the line."""

import os
from collections.abc import Mapping
from typing import Any

from msgspec import Struct

from services.runtime import vehicles
from services.runtime.errors import UsageError
from services.runtime.realm import default_name, vehicle_name

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
        return self.named or vehicles.the_only(self.realm, self.connect, self.timeout)

    @property
    def vehicles(self) -> list[str]:
        """All vehicles of the run that the one meant belongs to, itself among them."""
        there = vehicles.of(self.realm, self.connect, self.timeout)
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
        from services.runtime.security.identity import choose

        choose(folder)
    return Options(
        realm=said.get("realm") or default_name(),
        connect=said.get("connect", ""),
        named=vehicle_name(named) if named else "",
        json=said.get("json", False),
        timeout=timeout,
    )
