"""What a shell completes a word with: live names, at once, or nothing."""

from collections.abc import Callable, Iterable
from typing import Any

import msgspec
import typer

from cli import names
from cli.declare import Names
from cli.options import Options
from cli.param.names import nodes_with_params
from schemas.params import Params
from schemas.requests import GetParamsRequest
from schemas.topics import get_params
from services.runtime.client import Client
from services.runtime.errors import QuadctlError
from services.runtime.params import flatten

_PATIENCE = 0.1
"""Seconds that a live name may take to come: a shell that waits for longer seems stuck."""

Completer = Callable[[typer.Context, str], list[str]]


def completer(kind: Names, options_of: Callable[[typer.Context], Options]) -> Completer:
    """A function that tells the words of a kind that begin as the incomplete one does."""

    def complete(ctx: typer.Context, incomplete: str) -> list[str]:
        try:
            found = _words(kind, options_of(ctx), ctx.params)
            return sorted({word for word in found if word.startswith(incomplete)})
        except (QuadctlError, OSError):
            # Nobody there, or no such name: a shell has no place for an error.
            return []

    return complete


def _words(kind: Names, options: Options, said: dict[str, Any]) -> Iterable[str]:
    if kind == "setting":
        return [f"{name}=" for name, _ in flatten(msgspec.to_builtins(Params()))]
    if kind == "field":
        return [f"{field}=" for field in names.fields_of(said.get("name") or "", options.vehicle)]
    if kind == "type":
        return names.types()
    with Client(
        options.realm, options.vehicle, connect=options.connect, timeout=_PATIENCE
    ) as client:
        return _live(kind, client)


def _live(kind: Names, client: Client) -> list[str]:
    if kind == "node":
        return client.nodes()
    if kind == "param":
        return [name for node in nodes_with_params(client) for name in _params_of(client, node)]
    wanted = "@srv" if kind == "service" else "@pub"
    return [offer.name for offer in client.offers() if offer.kind == wanted]


def _params_of(client: Client, node: str) -> Iterable[str]:
    return client.call(get_params(node), GetParamsRequest([])).values
