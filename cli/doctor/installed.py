"""Facts of the installation: which Python, which packages, and whose `services` is found."""

import hashlib
import os
import sys
from base64 import urlsafe_b64encode
from importlib import metadata
from importlib.machinery import PathFinder
from pathlib import Path
from typing import NamedTuple

from cli.doctor.versions import Requirement, requirement

PACKAGES = ("services", "schemas", "cli")
"""Our top-level packages, whose names are anybody's."""


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
        folder=str(Path(__file__).resolve().parents[2]),
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
