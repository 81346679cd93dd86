"""Checks of the installation: Python, packages, and the origin of the modules imported."""

import csv
import hashlib
import sys
import sysconfig
from base64 import urlsafe_b64encode
from collections.abc import Iterator, Mapping
from importlib import metadata
from importlib.machinery import PathFinder
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from quadctl.cli.doctor.check import Finding, failed, passed, warned

_PACKAGE = "quadctl"
"""Our only top-level package."""


class Installed(NamedTuple):
    """The installed packages, and the folders from which `quadctl` would be imported.

    `found` is the folder for a process of `quadctl up`, `here` the one for `python -m` in the
    working directory; both are empty where no such package is found. `claimed` has the other
    installed distributions with a package `quadctl`, `altered` the files of ours that differ from
    those that were installed.
    """

    python: str
    build: str
    needed_python: str
    versions: dict[str, str | None]
    requirements: list[Requirement]
    folder: str
    found: str
    here: str
    claimed: list[str]
    altered: list[str]


def installed() -> Installed:
    """Gather the facts of the installation."""
    ours = metadata.distribution(_PACKAGE)
    required = [Requirement(text) for text in ours.requires or ()]
    # Those with a marker belong to an extra or to another platform.
    required = [requirement for requirement in required if requirement.marker is None]
    # The first entry is the folder of the script, or the working directory of `python -m`.
    path = sys.path if sys.flags.safe_path else sys.path[1:]
    owners = metadata.packages_distributions().get(_PACKAGE, ())
    return Installed(
        python=".".join(map(str, sys.version_info[:3])),
        build=build(),
        needed_python=ours.metadata["Requires-Python"] or "",
        versions={_PACKAGE: ours.version, **{r.name: _version(r.name) for r in required}},
        requirements=required,
        folder=str(Path(str(sys.modules[_PACKAGE].__file__)).resolve().parents[1]),
        found=_origin(path),
        here=_origin(["", *path]),
        claimed=sorted(set(owners) - {_PACKAGE}),
        altered=_altered(ours),
    )


def build(
    prefix: str = sys.base_prefix, options: str | None = sysconfig.get_config_var("CONFIG_ARGS")
) -> str:
    """Return how an interpreter, by default this one, was built.

    Its prefix and configure's options, if known, show it.
    """
    if options is None:
        return "the installer's build"
    if "--enable-optimizations" in options:
        return "built with a profile"
    if prefix == "/usr":
        return "the distribution's build"
    return "built without a profile: a fifth to a third slower"


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _origin(path: list[str]) -> str:
    """Return the folder from which `quadctl` is imported with such a path, or an empty string."""
    spec = PathFinder.find_spec(_PACKAGE, path)
    if spec is None or spec.origin is None:
        return ""
    module = Path(spec.origin).resolve()
    return str(module.parents[1] if spec.submodule_search_locations else module.parent)


def _altered(ours: metadata.Distribution) -> list[str]:
    """Return the installed files of ours that are missing or changed."""
    # `ours.files` lacks the missing ones since Python 3.12.
    record = csv.reader((ours.read_text("RECORD") or "").splitlines())
    return [
        file
        for file, digest, _ in record
        if digest
        and file.startswith(f"{_PACKAGE}/")
        and not _is_intact(Path(str(ours.locate_file(file))), digest)
    ]


def _is_intact(file: Path, digest: str) -> bool:
    """Return whether a file has the digest of a RECORD, e.g. `sha256=47DEQpj8HBSa`."""
    try:
        data = file.read_bytes()
    except OSError:
        return False
    kind, _, wanted = digest.partition("=")
    found = hashlib.new(kind, data).digest()
    return urlsafe_b64encode(found).decode().rstrip("=") == wanted


_REINSTALL = "`python -m pip install --force-reinstall quadctl`, in an environment of its own"
_SHOWN = ("QUADCTL_", "XDG_RUNTIME_DIR", "PYTHONPATH")


def installation(facts: Installed) -> Iterator[Finding]:
    """Yield all checks of the installation."""
    yield python(facts)
    yield packages(facts)
    yield imports(facts)


def python(facts: Installed) -> Finding:
    """Check the interpreter's version, and name its build."""
    if facts.python not in SpecifierSet(facts.needed_python):
        return failed(
            "Python",
            f"{facts.python}, and quadctl needs {facts.needed_python}",
            "install a newer Python, and quadctl with it: `python3.12 -m venv .venv`",
        )
    return passed("Python", f"{facts.python}, {facts.build}")


def packages(facts: Installed) -> Finding:
    """Check that every required package is installed, within its bounds."""
    wrong = [
        f"{r.name} {facts.versions[r.name] or 'is not installed'}, needed {r.specifier}"
        for r in facts.requirements
        if not r.specifier.contains(facts.versions[r.name] or "0", prereleases=True)
    ]
    if wrong:
        wanted = " ".join(f"'{r.name}{r.specifier}'" for r in facts.requirements)
        return failed("packages", "\n".join(wrong), f"`python -m pip install {wanted}`")
    versions = ", ".join(f"{name} {version}" for name, version in facts.versions.items())
    return passed("packages", versions)


def imports(facts: Installed) -> Finding:
    """Check that `import quadctl` gives this quadctl, in its processes and in this folder."""
    name, ours = "imports", facts.folder
    if facts.found != ours:
        return failed(
            name,
            f"this is quadctl of {ours}, and the processes that it starts would import"
            f" {_other(facts.found)}",
            f"unset PYTHONPATH, remove the other quadctl, or `python -m pip install -e {ours}`",
        )
    if facts.altered:
        return failed(name, f"changed since the installation: {_few(facts.altered)}", _REINSTALL)
    if facts.claimed:
        return failed(
            name,
            f"{_PACKAGE} is also in {', '.join(facts.claimed)}: the one installed last has"
            " overwritten the other",
            f"`python -m pip uninstall {' '.join(facts.claimed)}`, then {_REINSTALL}",
        )
    if facts.here != ours:
        return warned(
            name,
            f"`python -m` and your own scripts in this folder import {_other(facts.here)}",
            "give that folder or file another name, or use `python -P`",
        )
    return passed(name, f"{_PACKAGE} is that of {ours}")


def _other(folder: str) -> str:
    return f"{_PACKAGE} from {folder}" if folder else f"no {_PACKAGE} at all"


def environment(variables: Mapping[str, str]) -> Finding:
    """Check the environment variables that change quadctl's behaviour."""
    shown = {name: value for name, value in variables.items() if name.startswith(_SHOWN)}
    listed = ", ".join(f"{name}={value}" for name, value in sorted(shown.items()))
    slow = "PYTHONDONTWRITEBYTECODE"
    if variables.get(slow):
        return warned(
            "environment",
            f"{slow} is set: every start compiles all modules again"
            + (f"; also {listed}" if listed else ""),
            f"`unset {slow}`",
        )
    return passed("environment", listed or "no variable of quadctl is set")


def _few(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
