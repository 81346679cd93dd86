"""Protocol of each shell: the line typed so far, and the words that fit.

The script that a shell runs at TAB calls `quadctl` with `_QUADCTL_COMPLETE=complete_SHELL` and the
line in its environment. bash splits a word at the characters of COMP_WORDBREAKS, e.g. `=` and `:`,
and replaces only the last part; only that part is printed for it.
"""

import os
import shlex
from collections.abc import Callable, Mapping

from quadctl.cli.completion.engine import Found, candidates

VARIABLE = "_QUADCTL_COMPLETE"
_PREFIX = "complete_"


def answer(environment: Mapping[str, str] = os.environ) -> str | None:
    """Return the text to print for a shell, None without a request for completions."""
    shell = environment.get(VARIABLE, "").removeprefix(_PREFIX)
    write = _WRITERS.get(shell)
    if write is None:
        return None
    if shell == "bash":
        before, begun = _bash_words(environment)
    else:
        before, begun = _line_words(environment.get("_TYPER_COMPLETE_ARGS", ""))
    found = candidates(before, begun, explain=shell != "bash")
    return write(found if shell != "bash" else _last_parts(found, begun, environment))


def _bash_words(environment: Mapping[str, str]) -> tuple[list[str], str]:
    """Return the words up to the cursor: of the line itself, or as COMP_CWORD counts them."""
    line, count = environment.get("COMP_WORDS", ""), environment.get("COMP_CWORD", "")
    if not count.isdigit():
        return _line_words(line)
    words = _split(line)
    return words[1 : int(count)], "".join(words[int(count) : int(count) + 1])


def _line_words(line: str) -> tuple[list[str], str]:
    words = _split(line)[1:]
    return (words, "") if not words or line[-1:].isspace() else (words[:-1], words[-1])


def _split(line: str) -> list[str]:
    """Split a line as the shell will; close an open quote at the end."""
    for close in ("", "'", '"'):
        try:
            return shlex.split(line + close)
        except ValueError:
            continue
    return line.split()


def _last_parts(found: list[Found], begun: str, environment: Mapping[str, str]) -> list[Found]:
    """Return the part of each word that bash replaces: after the last word-breaking character."""
    breaks = environment.get("COMP_WORDBREAKS", "")
    kept = 1 + max((place for place, char in enumerate(begun) if char in breaks), default=-1)
    return [Found(fit.word[kept:]) for fit in found]


def _for_bash(found: list[Found]) -> str:
    # A file's name may contain a blank.
    return "\n".join(fit.word.replace(" ", r"\ ") for fit in found)


def _for_zsh(found: list[Found]) -> str:
    """Return code to evaluate: after `zero=` the word goes on, after others a blank follows."""
    calls = []
    for suffix, fits in (
        ("-S ''", [fit for fit in found if _continues(fit)]),
        ("", [fit for fit in found if not _continues(fit)]),
    ):
        if fits:
            described = (
                shlex.quote(":".join((fit.word.replace(":", r"\:"), fit.about)).rstrip(":"))
                for fit in fits
            )
            calls.append(f"local -a found=({' '.join(described)}); _describe '' found {suffix}")
    return "\n".join(calls)


def _for_powershell(found: list[Found]) -> str:
    return "\n".join(f"{fit.word}:::{fit.about or ' '}" for fit in found)


def _continues(fit: Found) -> bool:
    return fit.word.endswith(("=", "/"))


_WRITERS: dict[str, Callable[[list[Found]], str]] = {
    "bash": _for_bash,
    "zsh": _for_zsh,
    "fish": lambda found: "\n".join(f"{fit.word}\t{fit.about}".rstrip() for fit in found),
    "powershell": _for_powershell,
    "pwsh": _for_powershell,
}

SCRIPTS = {
    "bash": """
%(complete_func)s() {
    local IFS=$'\\n'
    COMPREPLY=( $( COMP_WORDS="${COMP_LINE:0:COMP_POINT}" COMP_CWORD="" \\
                   COMP_WORDBREAKS="$COMP_WORDBREAKS" \\
                   %(autocomplete_var)s=complete_bash "$1" 2>/dev/null ) )
    case "${COMPREPLY[*]}" in *[=/]) compopt -o nospace 2>/dev/null ;; esac
}

complete -F %(complete_func)s %(prog_name)s
""",
    "zsh": """
#compdef %(prog_name)s

%(complete_func)s() {
    eval "$( _TYPER_COMPLETE_ARGS="${(j: :)words[1,CURRENT]}" \\
             %(autocomplete_var)s=complete_zsh %(prog_name)s 2>/dev/null )"
}

if [ "$funcstack[1]" = "_%(prog_name)s" ]; then
    %(complete_func)s
else
    compdef %(complete_func)s %(prog_name)s
fi
""",
    "fish": (
        'complete --command %(prog_name)s --no-files --arguments "(env'
        " %(autocomplete_var)s=complete_fish _TYPER_COMPLETE_ARGS=(commandline -cp | string collect)"
        ' %(prog_name)s 2>/dev/null)"'
    ),
}
"""Replacements of Typer's, which split words at `=`, offer files everywhere, or ask twice."""
