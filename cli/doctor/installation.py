"""Judges the installation; pure."""

from collections.abc import Iterator, Mapping

from cli.doctor.check import Check, failed, passed, warned
from cli.doctor.installed import Installed
from cli.doctor.versions import satisfies

_REINSTALL = "`python -m pip install --force-reinstall quadctl`, in an environment of its own"
_SHOWN = ("QUADCTL_", "XDG_RUNTIME_DIR", "PYTHONPATH")


def installation(facts: Installed) -> Iterator[Check]:
    """All checks of the installation."""
    yield python(facts)
    yield packages(facts)
    yield imports(facts)


def python(facts: Installed) -> Check:
    """The interpreter's version."""
    if not satisfies(facts.python, facts.needed_python):
        return failed(
            "Python",
            f"{facts.python}, and quadctl needs {facts.needed_python}",
            "install a newer Python, and quadctl with it: `python3.12 -m venv .venv`",
        )
    return passed("Python", facts.python)


def packages(facts: Installed) -> Check:
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


def imports(facts: Installed) -> Check:
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


def environment(variables: Mapping[str, str]) -> Check:
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
