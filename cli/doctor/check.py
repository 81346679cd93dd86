"""Finding of a check: its verdict, the evidence, and the command that repairs the fault."""

import re
from collections.abc import Iterable
from typing import Literal

from msgspec import Struct
from msgspec.structs import replace

Verdict = Literal["PASS", "WARN", "FAIL"]


class Finding(Struct, frozen=True):
    """Result of one check; `fix` is empty if nothing needs repair."""

    name: str
    verdict: Verdict
    evidence: str
    fix: str = ""


def passed(name: str, evidence: str) -> Finding:
    """Return a PASS: all is well."""
    return Finding(name, "PASS", evidence)


def warned(name: str, evidence: str, fix: str = "") -> Finding:
    """Return a WARN: it works, but not as it should, or it could not be checked."""
    return Finding(name, "WARN", evidence, fix)


def failed(name: str, evidence: str, fix: str) -> Finding:
    """Return a FAIL: it does not work, or soon will not."""
    return Finding(name, "FAIL", evidence, fix)


def no_duplicates(name: str, duplicates: list[str], evidence: str) -> Finding:
    """Return a FAIL with a line for each key that is served or published twice, else a PASS."""
    if not duplicates:
        return passed(name, evidence)
    fix = "end the one that the supervisor has not started: `quadctl node list` shows the nodes"
    return failed(name, "\n".join(duplicates), fix)


def with_options(checks: Iterable[Finding], options: str) -> list[Finding]:
    """Add common options, e.g. `--realm lab`, to every quadctl command of the fixes."""

    def complete(match: re.Match[str]) -> str:
        command = match[1]
        return f"`{command} {options}`" if options and "--realm" not in command else f"`{command}`"

    return [
        replace(check, fix=re.sub(r"`(quadctl [^`]*)`", complete, check.fix)) for check in checks
    ]


def text_of(check: Finding) -> str:
    """Format a finding as lines, the fix last."""
    first, *more = check.evidence.splitlines() or [""]
    lines = [f"{check.verdict}  {check.name}: {first}", *(f"      {line}" for line in more)]
    if check.fix:
        lines.append(f"      try: {check.fix}")
    return "\n".join(lines)
