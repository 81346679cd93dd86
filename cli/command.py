"""One `quadctl` command line, from its words to the exit code of the process."""

import _signal
import errno
import gc
import os
import sys

# fast_imports comes first: it imports msgspec.
from quadctl.cli import fast_imports, output, parser  # noqa: F401
from quadctl.cli.context import options_of
from quadctl.services.runtime.errors import Invalid, QuadctlError, UsageError

_CTRL_C = 130
_COMPLETING = "_QUADCTL_COMPLETE"
_CD = "`cd` to another folder: this one was deleted"
_OWNER = "give the file to your user, or name another place"
_ROOM = "make room on its disk"
_REMEDIES = {
    errno.EACCES: _OWNER,
    errno.EPERM: _OWNER,
    errno.EROFS: "name a place that can be written to, or set HOME to one",
    errno.ENOSPC: _ROOM,
    getattr(errno, "EDQUOT", errno.ENOSPC): _ROOM,
    errno.EMFILE: "raise `ulimit -n`",
    errno.ENFILE: "end other programs, which have too many files open",
    errno.ENOMEM: "end other programs, which take the memory",
    errno.EAGAIN: "raise `ulimit -u`, or end other programs",
}
"""Remedies for what a machine may refuse to any command."""
_NAMING = {errno.ENAMETOOLONG, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ELOOP}
"""Faults of a name, which the user gave."""


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
        if _is_folder_gone(problem.__cause__):
            problem.hint = _CD
        output.error(problem, as_json=as_json)
        code = problem.exit_code
    except KeyboardInterrupt:
        code = _CTRL_C
    except BrokenPipeError:
        # The reader, e.g. `head`, has all that it wanted.
        code = 0
    except Exception as problem:  # noqa: BLE001 - the outermost handler reports any bug
        output.error(_explained(problem), as_json=as_json)
        code = QuadctlError.exit_code
    _leave(code)


def _explained(problem: Exception) -> QuadctlError:
    """Return the error for what the machine refused, or for a bug, with its traceback on stderr."""
    if _is_folder_gone(problem):
        return QuadctlError("the current folder was deleted", _CD)
    if isinstance(problem, OSError):
        place = f"{problem.filename}: " if problem.filename else ""
        if problem.errno in _REMEDIES:
            return QuadctlError(f"{place}{problem.strerror}", _REMEDIES[problem.errno])
        if place and problem.errno in _NAMING:
            return Invalid(f"{place}{problem.strerror}", "name another file or folder")
    import traceback

    traceback.print_exc()
    text = f"unexpected: {type(problem).__name__}: {problem}"
    return QuadctlError(text, "please report this, with the lines above")


def _is_folder_gone(problem: BaseException | None) -> bool:
    """Return whether a file is missing because the current folder was deleted."""
    if not isinstance(problem, FileNotFoundError):
        return False
    try:
        os.getcwd()  # noqa: PTH109 - pathlib is slow to import
    except FileNotFoundError:
        return True
    return False


def _run(words: list[str]) -> None:
    if os.environ.get(_COMPLETING):
        from quadctl.cli.completion import shells

        if (fits := shells.answer()) is not None:
            output.line(fits)
            return
        from quadctl.cli.completion import installation

        installation.show(os.environ[_COMPLETING].rpartition("_")[2])
        return
    try:
        line = parser.read(words)
    except UsageError:
        from quadctl.cli import habits

        ours = habits.translated(words)
        if ours == words:
            raise
        line = parser.read(ours)
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
