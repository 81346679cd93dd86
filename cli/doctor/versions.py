"""Version bounds as packages declare them, `eclipse-zenoh<2,>=1.10`; pure.

Releases are compared, and what comes after them (`rc1`, `.post2`) is left out of account.
"""

import operator
import re
from collections.abc import Callable
from typing import NamedTuple

_REQUIREMENT = re.compile(r"\s*([A-Za-z0-9._-]+)\s*(?:\[[^\]]*\])?\s*\(?([^;)]*)\)?\s*(;.*)?")
_BOUND = re.compile(r"(>=|<=|==|!=|~=|>|<)\s*v?([0-9.]+)")
_RELEASE = re.compile(r"v?([0-9]+(?:\.[0-9]+)*)")
_HOLDS: dict[str, Callable[[tuple[int, ...], tuple[int, ...]], bool]] = {
    ">=": operator.ge, "<=": operator.le, "==": operator.eq, "!=": operator.ne,
    ">": operator.gt, "<": operator.lt,
}  # fmt: skip


class Requirement(NamedTuple):
    """A package and the bounds on its version."""

    name: str
    bounds: str


def requirement(text: str) -> Requirement | None:
    """A requirement as metadata says it; None where it holds for some installations only."""
    found = _REQUIREMENT.fullmatch(text)
    if found is None or found[3]:
        return None
    return Requirement(found[1], found[2].strip())


def satisfies(version: str, bounds: str) -> bool:
    """Whether a version is within bounds such as `<2,>=1.10`."""
    return all(
        _holds(version, sign, bound) for sign, bound in _BOUND.findall(bounds.replace(".*", ""))
    )


def _holds(version: str, sign: str, bound: str) -> bool:
    if sign == "~=":
        upper = bound.rpartition(".")[0]
        return _holds(version, ">=", bound) and _release(version)[
            : upper.count(".") + 1
        ] == _release(upper)
    ours, theirs = _release(version), _release(bound)
    longest = max(len(ours), len(theirs))
    return _HOLDS[sign](_padded(ours, longest), _padded(theirs, longest))


def _release(version: str) -> tuple[int, ...]:
    found = _RELEASE.match(version)
    return tuple(int(part) for part in found[1].split(".")) if found else ()


def _padded(release: tuple[int, ...], length: int) -> tuple[int, ...]:
    return release + (0,) * (length - len(release))
