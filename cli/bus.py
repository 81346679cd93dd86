"""A command's connection, made from its common options."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cli import options

if TYPE_CHECKING:
    import typer

    from services.runtime.client import Client


def connect(ctx: typer.Context) -> Client:
    """Connect to the hub that the options name; raises Unreachable when there is none."""
    from services.runtime.client import Client

    chosen = options.of(ctx)
    return Client(chosen.realm, chosen.vehicle, connect=chosen.connect, timeout=chosen.timeout)
