"""The names that a word can be: those that live now, at once, or none."""

import contextlib
import time
from collections.abc import Iterable, Iterator

import msgspec

from cli import names as known
from cli import which
from cli.declare import Names
from cli.options import Options
from cli.param.names import nodes_with_params
from schemas.params import Params
from schemas.requests import GetParamsRequest
from schemas.topics import get_params
from services.runtime.bus.client import Client
from services.runtime.errors import QuadctlError, UsageError
from services.runtime.settings.named import flatten

SUBJECTS = ("topic", "service")
"""What has fields."""
_ALL = "*"
_PATIENCE = 0.1
"""Seconds that live names may take to come: a shell that waits for longer seems stuck."""


def names(kind: Names, options: Options, begun: str, subject: str) -> Iterable[str]:
    """The names of a kind; `field` is one of the subject's, a topic or service.

    A topic or service is spelled as it was begun: by its name, or by its full key.
    """
    try:
        return list(_names(kind, options, begun, subject))
    except (QuadctlError, OSError):
        # Nobody there, or no such name: a shell has no place for an error.
        return []


def _names(kind: Names, options: Options, begun: str, subject: str) -> Iterable[str]:
    if not kind:
        return []
    if kind == "setting":
        return [f"{name}=" for name, _ in flatten(msgspec.to_builtins(Params()))]
    if kind == "field":
        vehicle = which.about_topic(options, subject).named or _vehicle(options)
        return [f"{field}=" for field in known.fields_of(subject, vehicle)]
    if kind == "type":
        return known.types()
    until = time.monotonic() + _PATIENCE
    vehicle = _vehicle(options)
    with Client(options.realm, vehicle, connect=options.connect, timeout=_PATIENCE) as client:
        return list(_live(kind, client, begun, until))


def _vehicle(options: Options) -> str:
    """The one that is meant; of several the pattern of them all."""
    try:
        return options.vehicle
    except UsageError:
        return _ALL


def _live(kind: Names, client: Client, begun: str, until: float) -> Iterator[str]:
    if kind == "node":
        yield from sorted({*client.nodes()})
    elif kind == "vehicle":
        yield from client.vehicles()
    elif kind == "param":
        for node in nodes_with_params(client):
            client.timeout = max(until - time.monotonic(), 0.001)
            # One that does not answer must not hide the others' names.
            with contextlib.suppress(QuadctlError):
                yield from client.call(get_params(node), GetParamsRequest([])).values
    else:
        wanted = "@srv" if kind == "service" else "@pub"
        offers = (offer for offer in client.offers() if offer.kind == wanted)
        if begun.startswith("/"):
            yield from (f"/{offer.key}" for offer in offers)
        elif client.vehicle == _ALL or begun.startswith(f"{client.vehicle}/"):
            yield from (offer.key for offer in offers)
        else:
            yield from (offer.name for offer in offers)
