"""The command line as an app of Typer, made from the same declarations: what the parser is held to.

It differs from Typer in what the parser adds: `-1` is a number where a command takes numbers, `1_0` is
none, `help` is a word, the value of an option with an ending may be left out, and `-- --help` is no help.
"""

import inspect
from collections.abc import Callable, Iterator
from functools import cache
from typing import Annotated, Any

import typer
from typer._click import types
from typer.core import TyperCommand, TyperGroup, TyperOption
from typer.main import get_command

from quadctl.cli import commands
from quadctl.cli.context import COMMON
from quadctl.cli.declarations import (
    Arg,
    Parameter,
    ParsedCommand,
    is_number,
    takes_signed,
    words_of,
)
from quadctl.cli.help_pages import ABOUT, EXITS

_KEY = "quadctl.options"
_NO_WRAPPING = 10_000


def read(words: list[str]) -> ParsedCommand | int:
    """Return a parsed line, or the exit code of a refusal or after help."""
    try:
        found = app()(args=words, standalone_mode=False, prog_name="quadctl")
    except typer.TyperException as refusal:
        return refusal.exit_code
    return found if isinstance(found, ParsedCommand) else int(found or 0)


@cache
def app() -> Any:
    """Return the group of all commands."""
    root = typer.Typer(
        cls=_Group,
        help=ABOUT,
        rich_markup_mode=None,
        epilog=EXITS,
        context_settings={
            "help_option_names": ["--help", "-h"],
            "terminal_width": _NO_WRAPPING,
        },
        no_args_is_help=True,
    )
    root.callback()(_first)
    groups = {"": root}
    for path, about in commands.GROUPS.items():
        outer, _, name = path.rpartition(" ")
        groups[path] = typer.Typer(help=about)
        groups[outer].add_typer(groups[path], name=name, cls=_Group, no_args_is_help=True)
    for path in commands.COMMANDS:
        group, _, name = path.rpartition(" ")
        _add(groups[group], name, path)
    return get_command(root)


def _add(group: typer.Typer, name: str, path: str) -> None:
    command = commands.command(path)
    words = words_of(command)

    def run(ctx: typer.Context, **values: Any) -> ParsedCommand:
        return ParsedCommand(command, _common_values(ctx), values)

    run.__doc__ = command.__doc__
    types_ = {"ctx": typer.Context} | {word.name: _annotated(word) for word in words}
    defaults = {word.name: word.default for word in words if not word.required}
    kind, none = inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.empty
    run.__annotations__ = types_
    run.__signature__ = inspect.Signature([  # type: ignore[attr-defined]
        inspect.Parameter(name, kind, annotation=type_, default=defaults.get(name, none))
        for name, type_ in types_.items()
    ])  # fmt: skip
    group.command(
        name, cls=_Command, short_help=commands.meaning(path), hidden=path in commands.ALIASES
    )(run)


def _annotated(word: Parameter) -> Any:
    declaration = word.declaration
    facts: dict[str, Any] = {"help": declaration.about, "readable": False}
    info = (
        typer.Argument(metavar=word.placeholder, **facts)
        if isinstance(declaration, Arg)
        else typer.Option(
            *word.names, min=declaration.min, metavar=declaration.metavar or None, **facts
        )
    )
    type_: Any = word.type
    if word.many:
        type_ = list[type_]
    elif word.count > 1:
        type_ = tuple[(type_,) * word.count]  # type: ignore[misc]
    return Annotated[type_ if word.required or word.default is not None else type_ | None, info]


def _first(
    show: Annotated[
        bool,
        typer.Option(
            "--version",
            help="Print the version and exit.",
            is_eager=True,
            callback=lambda given: _exit() if given else None,
        ),
    ] = False,
) -> None:
    """Take the options before a command."""


def _exit() -> None:
    raise typer.Exit


class _Command(TyperCommand):
    """Command with the common options."""

    def __init__(self, *args: Any, params: list[Any] | None = None, **kwargs: Any) -> None:
        super().__init__(*args, params=[*(params or []), *_common()], **kwargs)

    def make_parser(self, ctx: Any) -> Any:
        """Return Typer's parser with the rules for numbers and for options with an ending."""
        parser: Any = super().make_parser(ctx)
        words = words_of(commands.command(ctx.command_path.partition(" ")[2]))
        process: Callable[[str, Any], None] = parser._process_opts
        optional = {name: word for word in words if word.is_option for name in word.names}

        def process_ours(text: str, state: Any) -> None:
            if takes_signed(words) and is_number(text) and text[:2] not in parser._short_opt:
                state.largs.append(text)
            elif text in optional and optional[text].is_left_out(state.rargs):
                process(f"{text}=", state)
            else:
                process(text, state)

        parser._process_opts = process_ours
        return parser


class _Group(TyperGroup):
    """Group of commands; it takes the common options before the command's name."""

    def __init__(self, *, params: list[Any] | None = None, **kwargs: Any) -> None:
        super().__init__(params=[*(params or []), *_common()], **kwargs)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command; after `help`, with its help. A word after -- is never an option."""
        if ctx.parent is None and args[0] == "help":
            words = [word for word in args[1:] if not word.startswith("-")]
            if words:
                return self.resolve_command(ctx, [*words, "--help"])
            return super().resolve_command(ctx, ["--help"])
        if args[0].startswith("-"):
            ctx.fail(f"No such command '{args[0]}'.")
        return super().resolve_command(ctx, args)


def _common() -> Iterator[TyperOption]:
    for name, (type_, text) in COMMON.items():
        flag: dict[str, Any] = {"is_flag": True, "default": False} if type_ is bool else {}
        yield TyperOption(
            param_decls=[f"--{name}"],
            type=type_,
            help=text,
            expose_value=False,
            callback=_store,
            **flag,
        )


def _store(ctx: typer.Context, param: Any, value: Any) -> None:
    if value is not None and value is not False:
        ctx.meta.setdefault(f"{_KEY}.{ctx.command_path}", {})[param.name] = value


def _common_values(ctx: Any) -> dict[str, Any]:
    """Return the common options; the innermost context that gives one wins."""
    outer = _common_values(ctx.parent) if ctx.parent is not None else {}
    inner: dict[str, Any] = ctx.meta.get(f"{_KEY}.{ctx.command_path}", {})
    return outer | inner


def _strict(number: Callable[[Any], Any]) -> Any:
    def read_number(value: Any) -> Any:
        if isinstance(value, str) and "_" in value:
            raise ValueError
        return number(value)

    return staticmethod(read_number)


types.FloatParamType._number_class = _strict(float)
types.IntParamType._number_class = _strict(int)
types.IntRange.name = "int"  # its bound stands beside the meaning
