"""The names that a word can be: those that live now, at once, or none."""

import contextlib
import time
from collections.abc import Iterable, Iterator

import msgspec

from cli import names as known
from cli import which
from cli.complete import spelled
from cli.declare import Names
from cli.options import Options
from cli.param.names import nodes_with_params
from schemas.params import Params
from schemas.services import GetParamsRequest
from schemas.topics import TOPICS, get_params
from services.runtime.bus.client import Client
from services.runtime.errors import QuadctlError, UsageError
from services.runtime.params.names import flatten

SUBJECTS = ("topic", "service")
"""What has fields."""
_ALL = "*"
_PATIENCE = 0.1
"""Seconds that live names may take to come: a shell that waits for longer seems stuck."""


def names(kind: Names, options: Options, begun: str, subject: str) -> Iterable[str]:
    """The names of a kind; `field` is one of the subject's, a topic or service.

    Each is spelled as it was begun: by its name, or by its full key, with or without a slash.
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
        settings = (name for name, _ in flatten(msgspec.to_builtins(Params())))
        return [f"{spelling}=" for name in settings for spelling in spelled.setting(name, begun)]
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
    vehicle = client.vehicle
    if kind == "node":
        for name in sorted({*client.nodes()}):
            yield from spelled.node(name, begun, vehicle)
    elif kind == "vehicle":
        yield from client.vehicles()
    elif kind == "param":
        for node in nodes_with_params(client):
            client.timeout = max(until - time.monotonic(), 0.001)
            # One that does not answer must not hide the others' names.
            with contextlib.suppress(QuadctlError):
                for name in client.call(get_params(node), GetParamsRequest([])).values:
                    yield from spelled.parameter(name, begun, vehicle)
    elif kind == "service":
        for offer in client.offers():
            if offer.kind == "@srv":
                yield from spelled.service(offer, begun, vehicle)
    else:
        for key in _topics(client):
            yield from spelled.topic(key, begun, vehicle)


def _topics(client: Client) -> Iterator[str]:
    """The keys of those that are published, and of those that wait for whoever wants to publish."""
    yield from (offer.key for offer in client.offers() if offer.kind == "@pub")
    for vehicle in client.vehicles() if client.vehicle == _ALL else [client.vehicle]:
        yield from (topic.key(vehicle) for topic in TOPICS if not topic.node)
