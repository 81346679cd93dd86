"""Checks of the installation: Python, packages, and the origin of the modules imported.

Versions are compared by release; suffixes such as `rc1` and `.post2` do not count.
"""

import hashlib
import operator
import os
import re
import sys
from base64 import urlsafe_b64encode
from collections.abc import Callable, Iterator, Mapping
from importlib import metadata
from importlib.machinery import PathFinder
from pathlib import Path
from typing import NamedTuple

from quadctl.cli.doctor.check import Finding, failed, passed, warned

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


PACKAGES = ("quadctl",)
"""Our top-level packages: an older release had others."""


class Installed(NamedTuple):
    """What is installed, and what an import of our packages would bring.

    `found` has the folder that each is imported from by a process of `quadctl up`, `here` by
    `python -m` in the working directory; `claimed` the other installed packages that have one
    of that name, `altered` our files that are not as they were installed.
    """

    python: str
    needed_python: str
    versions: dict[str, str | None]
    requirements: list[Requirement]
    folder: str
    found: dict[str, str]
    here: dict[str, str]
    claimed: dict[str, list[str]]
    altered: list[str]


def installed() -> Installed:
    """Look."""
    ours = metadata.distribution("quadctl")
    required = [found for text in ours.requires or () if (found := requirement(text))]
    # What stands first is the folder of the script, or where `python -m` was typed.
    path = sys.path if sys.flags.safe_path else sys.path[1:]
    owners = metadata.packages_distributions()
    return Installed(
        python=".".join(map(str, sys.version_info[:3])),
        needed_python=ours.metadata["Requires-Python"] or "",
        versions={"quadctl": ours.version, **{r.name: _version(r.name) for r in required}},
        requirements=required,
        folder=str(Path(str(sys.modules["quadctl"].__file__)).resolve().parents[1]),
        found={name: _origin(name, path) for name in PACKAGES},
        here={name: _origin(name, ["", *path]) for name in PACKAGES},
        claimed={name: sorted(set(owners.get(name, ())) - {"quadctl"}) for name in PACKAGES},
        altered=_altered(ours),
    )


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _origin(name: str, path: list[str]) -> str:
    """The folder whose package of that name is imported with such a path, empty where none is."""
    spec = PathFinder.find_spec(name, path)
    if spec is None or spec.origin is None:
        return ""
    module = Path(spec.origin).resolve()
    return str(module.parents[1] if spec.submodule_search_locations else module.parent)


def _altered(ours: metadata.Distribution) -> list[str]:
    """Installed files of ours that are gone, or are not what was installed."""
    return [
        str(file)
        for file in ours.files or ()
        if file.hash is not None and file.parts[0] in PACKAGES and not _is_intact(file)
    ]


def _is_intact(file: metadata.PackagePath) -> bool:
    try:
        data = Path(os.fspath(file.locate())).read_bytes()
    except OSError:
        return False
    assert file.hash is not None  # noqa: S101 - asked for by the caller
    digest = hashlib.new(file.hash.mode, data).digest()
    return urlsafe_b64encode(digest).decode().rstrip("=") == file.hash.value


_REINSTALL = "`python -m pip install --force-reinstall quadctl`, in an environment of its own"
_SHOWN = ("QUADCTL_", "XDG_RUNTIME_DIR", "PYTHONPATH")


def installation(facts: Installed) -> Iterator[Finding]:
    """All checks of the installation."""
    yield python(facts)
    yield packages(facts)
    yield imports(facts)


def python(facts: Installed) -> Finding:
    """The interpreter's version."""
    if not satisfies(facts.python, facts.needed_python):
        return failed(
            "Python",
            f"{facts.python}, and quadctl needs {facts.needed_python}",
            "install a newer Python, and quadctl with it: `python3.12 -m venv .venv`",
        )
    return passed("Python", facts.python)


def packages(facts: Installed) -> Finding:
    """Every package that quadctl asks for, within its bounds."""
    wrong = [
        f"{name} {facts.versions[name] or 'is not installed'}, needed {bounds}"
        for name, bounds in facts.requirements
        if not satisfies(facts.versions[name] or "0", bounds)
    ]
    if wrong:
        wanted = " ".join(f"'{name}{bounds}'" for name, bounds in facts.requirements)
        return failed("packages", "\n".join(wrong), f"`python -m pip install {wanted}`")
    said = ", ".join(f"{name} {version}" for name, version in facts.versions.items())
    return passed("packages", said)


def imports(facts: Installed) -> Finding:
    """Our packages' names stand for our packages, whoever imports them."""
    name, ours = "imports", facts.folder
    if foreign := _foreign(facts.found, ours):
        return failed(
            name,
            f"this is quadctl of {ours}, and the processes that it starts would import {foreign}",
            "unset PYTHONPATH, remove what has that name there, or"
            f" `python -m pip install -e {ours}`",
        )
    if facts.altered:
        return failed(name, f"not as they were installed: {_few(facts.altered)}", _REINSTALL)
    if claimed := {package: by for package, by in facts.claimed.items() if by}:
        said = "; ".join(f"{package} is also in {', '.join(by)}" for package, by in claimed.items())
        others = " ".join(sorted({other for by in claimed.values() for other in by}))
        return failed(
            name,
            f"{said}: who was installed last has overwritten the other",
            f"`python -m pip uninstall {others}`, then {_REINSTALL}",
        )
    if foreign := _foreign(facts.here, ours):
        return warned(
            name,
            f"`python -m` and your own scripts in this folder import {foreign}, not quadctl's",
            "give that folder or file another name, or use `python -P`",
        )
    return passed(name, f"services, schemas and cli are those of {ours}")


def environment(variables: Mapping[str, str]) -> Finding:
    """Variables that change what quadctl does."""
    shown = {name: value for name, value in variables.items() if name.startswith(_SHOWN)}
    said = ", ".join(f"{name}={value}" for name, value in sorted(shown.items()))
    slow = "PYTHONDONTWRITEBYTECODE"
    if variables.get(slow):
        return warned(
            "environment",
            f"{slow} is set: every start compiles all modules again"
            + (f"; also {said}" if said else ""),
            f"`unset {slow}`",
        )
    return passed("environment", said or "no variable of ours is set")


def _foreign(found: Mapping[str, str], ours: str) -> str:
    return _few([
        f"{package} from {folder}" if folder else f"no {package} at all"
        for package, folder in found.items()
        if folder != ours
    ])  # fmt: skip


def _few(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
