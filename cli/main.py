"""The `quadctl` command: its verbs, and how each way of failing leaves the process."""

import os
import sys
import traceback
from typing import Annotated

import typer

from cli import (
    cage,
    demo,
    flight,
    goto,
    init,
    node,
    output,
    param,
    pressure,
    run,
    service,
    topic,
    types,
)
from cli.options import Command, Group
from services.runtime.errors import QuadctlError, UsageError

_CTRL_C = 130

# Boxes and colours are for people: what is piped on stays plain.
_MARKUP = "rich" if sys.stdout.isatty() and not os.environ.get("NO_COLOR") else None

app = typer.Typer(
    cls=Group,
    help="Fly the quadrotor lab: separate processes over Zenoh, a safety cage, two services.",
    rich_markup_mode=_MARKUP,  # type: ignore[arg-type]
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)

_NUMBERS_MAY_BE_NEGATIVE = {"ignore_unknown_options": True}

for name, function in {
    "up": run.up,
    "down": run.down,
    "status": run.status,
    "init": init.init,
    "demo": demo.demo,
    "calibrate": pressure.calibrate,
    "hold": flight.hold,
    "reset": flight.reset,
    "state": flight.state,
}.items():
    app.command(name, cls=Command)(function)
app.command("ps", cls=Command, hidden=True)(run.status)
app.command("goto", cls=Command, context_settings=_NUMBERS_MAY_BE_NEGATIVE)(goto.goto)
for name, group in {
    "cage": cage.app,
    "topic": topic.app,
    "service": service.app,
    "param": param.app,
    "node": node.app,
    "type": types.app,
}.items():
    app.add_typer(group, name=name, cls=Group, no_args_is_help=True)


@app.callback(invoke_without_command=True)
def _version(
    show: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if show:
        from importlib.metadata import version

        output.line(f"quadctl {version('quadctl')}")
        raise typer.Exit


def main() -> None:
    """Run the command line and exit with the code that says how it went."""
    as_json = "--json" in sys.argv[1:]
    try:
        _check_encoding(sys.argv[1:])
        code = app(standalone_mode=False, prog_name="quadctl") or 0
    except QuadctlError as problem:
        output.error(problem, as_json=as_json)
        code = problem.exit_code
    except typer.TyperException as problem:
        code = _usage(problem, as_json=as_json)
    except KeyboardInterrupt:
        code = _CTRL_C
    except BrokenPipeError:
        # The reader, such as `head`, has what it wanted.
        code = 0
    except Exception as problem:  # noqa: BLE001 - the last place where it can be told
        traceback.print_exc()
        text = f"unexpected: {type(problem).__name__}: {problem}"
        output.error(
            QuadctlError(text, "please report this, with the lines above"), as_json=as_json
        )
        code = QuadctlError.exit_code
    _leave(code)


def _check_encoding(words: list[str]) -> None:
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError as error:
            shown = word.encode(errors="backslashreplace").decode()
            raise UsageError(f"{shown} is not UTF-8", "write it in this terminal's own") from error


def _usage(problem: typer.TyperException, *, as_json: bool) -> int:
    code: int = getattr(problem, "exit_code", 2)
    message = getattr(problem, "format_message", lambda: str(problem))()
    ctx = getattr(problem, "ctx", None)
    if not message or message.startswith("Usage:"):
        # A group without a command: its help is the answer, and may be printed already.
        output.note(message) if message else None
        return code
    hint = f"{ctx.command_path} --help" if ctx is not None else "quadctl --help"
    said = QuadctlError(message, hint)
    said.code = "usage"
    output.error(said, as_json=as_json)
    return code


def _leave(code: int) -> None:
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except BrokenPipeError:
        pass
    # Sessions are closed and streams flushed; the interpreter's own farewell takes 5 ms more.
    os._exit(code)


if __name__ == "__main__":
    main()
