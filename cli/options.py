"""The options that every command has, declared once and understood at any place in the line."""

import os
from collections.abc import Iterator
from typing import Any

import typer
from msgspec import Struct
from typer.core import TyperCommand, TyperGroup, TyperOption

from services.runtime.errors import UsageError
from services.runtime.realm import default_name, vehicle_name

DEFAULT_TIMEOUT = 3.0
LONGEST_TIMEOUT = 86_400


class Options(Struct, frozen=True):
    """What the common options say."""

    realm: str
    connect: str
    vehicle: str
    json: bool
    timeout: float


def of(ctx: typer.Context) -> Options:
    """The common options of this invocation; the innermost place where one is given counts."""
    said = _said(ctx)
    timeout = said.get("timeout", DEFAULT_TIMEOUT)
    if not 0 < timeout <= LONGEST_TIMEOUT:
        raise UsageError(
            f"--timeout {timeout:g}: not a time",
            f"give seconds, more than 0, up to {LONGEST_TIMEOUT}",
        )
    return Options(
        realm=said.get("realm") or default_name(),
        connect=said.get("connect", ""),
        vehicle=vehicle_name(said.get("vehicle") or os.environ.get("QUADCTL_VEHICLE") or "uav"),
        json=said.get("json", False),
        timeout=timeout,
    )


class Command(TyperCommand):
    """A command with the common options."""

    def __init__(self, *args: Any, params: list[Any] | None = None, **kwargs: Any) -> None:
        super().__init__(*args, params=[*(params or []), *_common()], **kwargs)


class Group(TyperGroup):
    """A group of commands with the common options before the command's name."""

    def __init__(self, *, params: list[Any] | None = None, **kwargs: Any) -> None:
        super().__init__(params=[*(params or []), *_common()], **kwargs)


_KEY = "quadctl.options"


def _said(ctx: Any) -> dict[str, Any]:
    outer = _said(ctx.parent) if ctx.parent is not None else {}
    inner: dict[str, Any] = ctx.meta.get(f"{_KEY}.{ctx.command_path}", {})
    return outer | inner


def _store(ctx: typer.Context, param: Any, value: Any) -> None:
    if value is not None and value is not False:
        ctx.meta.setdefault(f"{_KEY}.{ctx.command_path}", {})[param.name] = value


def _common() -> Iterator[TyperOption]:
    texts: dict[str, tuple[Any, str]] = {
        "--realm": (str, "Name of the isolated run (env QUADCTL_REALM, default: default)."),
        "--connect": (str, "A hub's Zenoh endpoint, as tls/host:7447, instead of the realm's."),
        "--vehicle": (str, "First chunk of every key (env QUADCTL_VEHICLE, default: uav)."),
        "--timeout": (float, f"Seconds to wait for a reply (default: {DEFAULT_TIMEOUT:g})."),
    }
    for name, (type_, text) in texts.items():
        yield TyperOption(
            param_decls=[name],
            type=type_,
            help=text,
            expose_value=False,
            callback=_store,
            rich_help_panel="Common options",
        )
    yield TyperOption(
        param_decls=["--json"],
        is_flag=True,
        default=False,
        help="Machine-readable output.",
        expose_value=False,
        callback=_store,
        rich_help_panel="Common options",
    )
