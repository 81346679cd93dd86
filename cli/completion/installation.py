"""Installation of shell completion, by Typer: it knows each shell's files and how its script begins."""

import os
from pathlib import PurePath

import shellingham
from typer import _completion_shared as typer

from quadctl.cli import output
from quadctl.cli.completion.shells import SCRIPTS, VARIABLE
from quadctl.services.runtime.errors import QuadctlError

# Typer has no public way to set the scripts.
typer._completion_scripts.update(SCRIPTS)  # noqa: SLF001
_SHELLS = {shell.value for shell in typer.Shells}


def install() -> None:
    """Install the script of the shell in use; raise QuadctlError if a file cannot be changed."""
    try:
        shell, script = typer.install(_shell(), "quadctl", VARIABLE)
    except (OSError, UnicodeDecodeError) as problem:
        what = getattr(problem, "strerror", None) or "it is not UTF-8"
        place = getattr(problem, "filename", None) or "a file of your shell"
        hint = "`quadctl --show-completion` prints the script, for a place that your shell reads"
        raise QuadctlError(f"{place} cannot be changed: {what}", hint) from problem
    output.line(f"{shell} completion installed in {script}\nIt takes effect in a new terminal.")


def show(shell: str = "") -> None:
    """Print the script of a shell, or of the one in use; raise QuadctlError if there is none for it."""
    name = _known(shell) if shell else _shell()
    output.line(typer.get_completion_script(prog_name="quadctl", complete_var=VARIABLE, shell=name))


def _shell() -> str:
    """Return the name of the shell that runs this command, else of the user's own."""
    own = PurePath(os.environ.get("SHELL", "")).name
    try:
        name = shellingham.detect_shell()[0]
    except (shellingham.ShellDetectionFailure, OSError):  # e.g. there is neither /proc nor `ps`
        name = own
    return name if name in _SHELLS else _known(own)


def _known(shell: str) -> str:
    if shell in _SHELLS:
        return shell
    raise QuadctlError(
        f"there is no completion for {shell or 'your shell'}",
        f"run this in {', '.join(sorted(_SHELLS))}, or set SHELL to one of them",
    )
