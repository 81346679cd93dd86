"""One `quadctl` command line, from its words to the exit code of the process."""

import _signal
import gc
import os
import sys

# fast_imports comes first: it imports msgspec.
from quadctl.cli import fast_imports, fast_parser, output  # noqa: F401
from quadctl.cli.context import options_of
from quadctl.services.runtime.errors import QuadctlError, UsageError

_CTRL_C = 130
_COMPLETING = "_QUADCTL_COMPLETE"


def main() -> None:
    """Run the command line and exit with its exit code."""
    words = sys.argv[1:]
    as_json = "--json" in words
    try:
        output.ensure()
        _check_encoding(words)
        _run(words)
        output.flush()
        code = 0
    except SystemExit as leaving:
        code = leaving.code if isinstance(leaving.code, int) else 0
    except QuadctlError as problem:
        output.error(problem, as_json=as_json)
        code = problem.exit_code
    except KeyboardInterrupt:
        code = _CTRL_C
    except BrokenPipeError:
        # The reader, e.g. `head`, has all that it wanted.
        code = 0
    except Exception as problem:  # noqa: BLE001 - the outermost handler reports any bug
        import traceback

        traceback.print_exc()
        text = f"unexpected: {type(problem).__name__}: {problem}"
        bug = QuadctlError(text, "please report this, with the lines above")
        output.error(bug, as_json=as_json)
        code = QuadctlError.exit_code
    _leave(code)


def _run(words: list[str]) -> None:
    if _COMPLETING in os.environ:
        from quadctl.cli.completion import shells

        fits = shells.answer()
        if fits is not None:
            output.line(fits)
            return
    words = fast_parser.given(words)
    line = fast_parser.read(words)
    if line is None:
        from quadctl.cli import habits

        words = fast_parser.given(habits.translated(words))
        line = fast_parser.read(words)
    if line is None:
        from quadctl.cli import typer_app

        line = typer_app.read(words)
    # The imports are done: let the garbage collector scan only objects made from here on.
    gc.freeze()
    gc.enable()
    if hasattr(_signal, "pthread_sigmask"):  # blocked since main.py
        _signal.pthread_sigmask(_signal.SIG_UNBLOCK, {_signal.SIGINT})
    line.command(options_of(line.common), **line.values)


def _check_encoding(words: list[str]) -> None:
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError as error:
            shown = word.encode(errors="backslashreplace").decode()
            raise UsageError(f"{shown} is not UTF-8", "type it again in this terminal") from error


def _leave(code: int) -> None:
    # Sessions are closed and streams flushed; the interpreter's own shutdown takes 5 ms more.
    os._exit(code)
