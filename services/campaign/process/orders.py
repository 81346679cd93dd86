"""What the processes of a campaign say to each other: a JSON document a line."""

import sys
from typing import Any

import msgspec
from msgspec import Struct

from services.campaign.diary import Flown


class Order(Struct, frozen=True):
    """A campaign to fly, or with `replay` the flight of that seed alone, and its log."""

    flights: int
    seed: int
    seconds: float
    faults: bool
    wind: float
    processes: int
    replay: bool = False


class Job(Struct, frozen=True):
    """Flights with these seeds, for a worker; none means no more than to be ready."""

    first: int
    count: int
    seconds: float
    faults: bool
    wind: float


class Done(Struct, frozen=True):
    """A worker's answer."""

    flown: list[Flown]


def say(value: Any) -> None:
    """Write one document, at once."""
    sys.stdout.write(msgspec.json.encode(value).decode() + "\n")
    sys.stdout.flush()
