"""Typer app of the commands, for help, completion and error messages; the caller runs them."""

import inspect
import os
import re
import sys
from collections.abc import Iterator
from importlib.metadata import version
from typing import Annotated, Any

import typer
from typer import _completion_shared
from typer.core import TyperCommand, TyperGroup, TyperOption

from quadctl.cli import commands, output
from quadctl.cli.completion.shells import SCRIPTS
from quadctl.cli.context import COMMON, options_of
from quadctl.cli.declarations import (
    Arg,
    Parameter,
    ParsedCommand,
    is_number,
    takes_signed,
    words_of,
)
from quadctl.cli.habits import instead, instead_of_option
from quadctl.services.runtime.errors import QuadctlError, UsageError

_KEY = "quadctl.options"
_NO_WRAPPING = 10_000
_JOINED = re.compile(r"'([-+.\d]+(?:,[-+.\d]*)+)' is not a valid")
"""Error about numbers that are joined by commas."""
_OPTION = re.compile(r"No such option: (\S+)")
_EXITS = (
    "Exit codes: 0 done, 1 unexpected error, 2 usage, 3 no answer, 4 timeout, 5 refused by"
    " safety, 6 invalid parameter, message or schema, 7 already served, 8 fault found, 130 Ctrl-C."
)

# Scripts of `--show-completion` and `--install-completion`; Typer has no public way to set them.
_completion_shared._completion_scripts.update(SCRIPTS)  # noqa: SLF001


def read(words: list[str]) -> ParsedCommand:
    """Return a parsed line; raise UsageError, or SystemExit after help or completion."""
    plain = [word for word in words if not word.startswith("-")]
    if plain[:1] == ["help"]:
        # Users type `help`, `help topic` and `help topic echo`.
        return read([*plain[1:], "--help"])
    try:
        app = build(plain[0] if plain else "")
        found = app(args=words, standalone_mode=False, prog_name="quadctl")
    except typer.TyperException as problem:
        raise _usage(problem, commands.split(plain)[0]) from problem
    except (
        OSError,
        UnicodeDecodeError,
    ) as problem:  # only the installation of completion has files
        what = getattr(problem, "strerror", None) or "it is not UTF-8"
        place = getattr(problem, "filename", None) or "a file of your shell"
        hint = "`quadctl --show-completion` prints the script, for a place that your shell reads"
        raise QuadctlError(f"{place} cannot be changed: {what}", hint) from problem
    if isinstance(found, ParsedCommand):
        return found
    raise SystemExit(found or 0)


def _usage(problem: typer.TyperException, path: str) -> BaseException:
    code: int = getattr(problem, "exit_code", 2)
    message = getattr(problem, "format_message", lambda: str(problem))()
    ctx = getattr(problem, "ctx", None)
    if not message or message.startswith("Usage:"):
        # A group without a command shows its help, which Typer may have printed already.
        output.note(message) if message else None
        return SystemExit(code)
    if (found := _OPTION.search(message)) and (hint := instead_of_option(path, found[1])):
        return UsageError(message, hint)
    command = ctx.command_path if ctx is not None else f"quadctl {path}".rstrip()
    if found := _JOINED.search(message):
        numbers = found[1].replace(",", " ").split()
        if len(numbers) == 2:
            return UsageError(message, f"{'.'.join(numbers)}: a number has a point")
        if len(numbers) == 1:
            return UsageError(message, f"{numbers[0]}: without a comma")
        return UsageError(message, f"`{command} {' '.join(numbers)}`: without commas")
    return UsageError(message, f"`{command} --help`")


def build(first: str = "") -> typer.Typer:
    """Return the app; with a known `first` word of a line, only that part of it."""
    # Piped output stays plain: no boxes, colours or wrapped lines.
    seen = sys.stdout.isatty()
    markup = "rich" if seen and not os.environ.get("NO_COLOR") else None
    layout: dict[str, Any] = {} if seen else {"terminal_width": _NO_WRAPPING}
    app = typer.Typer(
        cls=_Group,
        help="Fly the quadrotor lab: separate processes over Zenoh, a safety cage, two services.",
        rich_markup_mode=markup,  # type: ignore[arg-type]
        epilog=_EXITS,
        context_settings={"help_option_names": ["--help", "-h"], **layout},
        no_args_is_help=True,
        add_completion=True,
        pretty_exceptions_enable=False,
    )
    app.callback(invoke_without_command=True)(_version)
    known = {path.partition(" ")[0] for path in commands.COMMANDS}
    groups = {"": app}
    for path in commands.COMMANDS:
        group, _, name = path.rpartition(" ")
        if first not in known or first == path.partition(" ")[0]:
            _add(_group(groups, group), name, path)
    return app


def _group(groups: dict[str, typer.Typer], path: str) -> typer.Typer:
    """Return the app of a group, made with those around it if it is new."""
    if path not in groups:
        outer, _, name = path.rpartition(" ")
        groups[path] = typer.Typer(help=commands.GROUPS[path])
        _group(groups, outer).add_typer(groups[path], name=name, cls=_Group, no_args_is_help=True)
    return groups[path]


def _add(app: typer.Typer, name: str, path: str) -> None:
    command = commands.command(path)
    words = words_of(command)

    def run(ctx: typer.Context, **values: Any) -> ParsedCommand:
        return ParsedCommand(command, _common_values(ctx), values)

    run.__doc__ = command.__doc__
    types = {"ctx": typer.Context} | {word.name: _annotated(word) for word in words}
    defaults = {word.name: word.default for word in words if not word.required}
    kind, none = inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.empty
    run.__annotations__ = types
    run.__signature__ = inspect.Signature([  # type: ignore[attr-defined]
        inspect.Parameter(name, kind, annotation=type_, default=defaults.get(name, none))
        for name, type_ in types.items()
    ])  # fmt: skip
    app.command(
        name,
        cls=_Command,
        short_help=(command.__doc__ or "").partition("\n")[0],
        hidden=path in commands.ALIASES,
        context_settings={"ignore_unknown_options": takes_signed(words)},
    )(run)


def _annotated(word: Parameter) -> Any:
    declaration = word.declaration
    default = None if word.is_option else word.name.upper()
    facts: dict[str, Any] = {"help": declaration.about, "metavar": declaration.metavar or default}
    info = (
        typer.Argument(**facts)
        if isinstance(declaration, Arg)
        else typer.Option(*word.names, min=declaration.min, **facts)
    )
    type_: Any = list[word.type] if word.many else word.type  # type: ignore[name-defined]
    return Annotated[type_ if word.required or word.default is not None else type_ | None, info]


def _version(
    ctx: typer.Context,
    show: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if show:
        found = version("quadctl")
        output.either(options_of(_common_values(ctx)), {"version": found}, f"quadctl {found}")
        raise typer.Exit


class _Command(TyperCommand):
    """Command with the common options."""

    def __init__(self, *args: Any, params: list[Any] | None = None, **kwargs: Any) -> None:
        super().__init__(*args, params=[*(params or []), *_common()], **kwargs)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Accept `-1` as a number, and other words that begin with - only if they are declared."""
        if ctx.ignore_unknown_options:
            self._check_options(ctx, args)
        return super().parse_args(ctx, args)

    def _check_options(self, ctx: Any, args: list[str]) -> None:
        # Typer leaves every unknown option among the positional words.
        values, left, _ = self.make_parser(ctx).parse_args([*args])
        placed: list[Any] = [*left]
        for word in self.params:
            if word.param_type_name == "argument":
                value = values.get(word.name or "")
                placed += value if isinstance(value, (list, tuple)) else [value]
        after = args[args.index("--") + 1 :] if "--" in args else []
        for text in placed:
            signed = isinstance(text, str) and len(text) > 1 and text.startswith("-")
            if signed and text not in after and not is_number(text):
                ours = instead_of_option(ctx.command_path.partition(" ")[2], text)
                help_ = f"`{ctx.command_path} --help`; a word after -- is never an option"
                raise UsageError(f"No such option: {text}", ours or help_)


class _Group(TyperGroup):
    """Group of commands; it takes the common options before the command's name."""

    def __init__(self, *, params: list[Any] | None = None, **kwargs: Any) -> None:
        super().__init__(params=[*(params or []), *_common()], **kwargs)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command; raise UsageError with ours for a word of another tool."""
        path = f"{ctx.command_path} {args[0]}".partition(" ")[2]
        if self.get_command(ctx, args[0]) is None and (hint := instead(path)):
            raise UsageError(f"No such command '{args[0]}'.", hint)
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
            rich_help_panel="Common options",
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
