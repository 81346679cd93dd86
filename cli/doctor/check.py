"""The finding of a check: its verdict, the evidence, and the command that mends it."""

import re
from collections.abc import Iterable
from typing import Literal

from msgspec import Struct
from msgspec.structs import replace

Verdict = Literal["PASS", "WARN", "FAIL"]


class Finding(Struct, frozen=True):
    """One check; `fix` is empty where nothing is to be mended."""

    name: str
    verdict: Verdict
    evidence: str
    fix: str = ""


def passed(name: str, evidence: str) -> Finding:
    """It is as it should be."""
    return Finding(name, "PASS", evidence)


def warned(name: str, evidence: str, fix: str = "") -> Finding:
    """It works, and is not as it should be; or it could not be looked at."""
    return Finding(name, "WARN", evidence, fix)


def failed(name: str, evidence: str, fix: str) -> Finding:
    """It does not work, or soon will not."""
    return Finding(name, "FAIL", evidence, fix)


def alone(name: str, doubled: list[str], evidence: str) -> Finding:
    """That nobody does again what a node of ours does: who does, a line each, or that all is well."""
    if not doubled:
        return passed(name, evidence)
    return failed(
        name,
        "\n".join(doubled),
        "end the one that the supervisor has not started: `quadctl node list` shows the nodes",
    )


def with_options(checks: Iterable[Finding], options: str) -> list[Finding]:
    """The checks with common options, such as `--realm lab`, in every command of ours."""

    def complete(command: re.Match[str]) -> str:
        said = command[1]
        return f"`{said} {options}`" if options and "--realm" not in said else f"`{said}`"

    return [
        replace(check, fix=re.sub(r"`(quadctl [^`]*)`", complete, check.fix)) for check in checks
    ]


def text_of(check: Finding) -> str:
    """A check as lines: what it found, and below it how to mend it."""
    first, *more = check.evidence.splitlines() or [""]
    lines = [f"{check.verdict}  {check.name}: {first}", *(f"      {line}" for line in more)]
    if check.fix:
        lines.append(f"      try: {check.fix}")
    return "\n".join(lines)
