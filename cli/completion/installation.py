"""Installation of shell completion, by Typer: it knows each shell's files, and which shell runs."""

from typing import NoReturn

import typer
from typer import _completion_shared

from quadctl.cli.completion.shells import SCRIPTS
from quadctl.services.runtime.errors import QuadctlError

# Scripts of `--show-completion` and `--install-completion`; Typer has no public way to set them.
_completion_shared._completion_scripts.update(SCRIPTS)  # noqa: SLF001


def run(*words: str) -> NoReturn:
    """Install or print the script of the shell, as a word or the environment asks; then exit."""
    app = typer.Typer(pretty_exceptions_enable=False)
    app.callback(invoke_without_command=True)(lambda: None)
    try:
        app(words, prog_name="quadctl")
    except (OSError, UnicodeDecodeError) as problem:
        what = getattr(problem, "strerror", None) or "it is not UTF-8"
        place = getattr(problem, "filename", None) or "a file of your shell"
        hint = "`quadctl --show-completion` prints the script, for a place that your shell reads"
        raise QuadctlError(f"{place} cannot be changed: {what}", hint) from problem
    raise SystemExit
