"""Hand-ins: copied to a folder for us alone, whatever a student has packed them with or put in them."""

import os
import re
import unicodedata
from collections.abc import Iterable, Mapping
from contextlib import closing
from pathlib import Path, PurePosixPath

from msgspec import Struct

from quadctl.cli.lab.archives import LAB, ArchiveEntry, entries, is_archive, reporting
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.load import check, read
from quadctl.services.runtime.process_table import table

NODES = ("safety", "pressure")
"""Nodes that a student may hand in."""
SOURCES = {f"my_{name}.py": name for name in NODES}
"""Files of the template's nodes, which need no quad.toml under these names."""
_TEMPLATE = Path(__file__).parent / "template" / LAB
_MOST_FILES, _MOST_BYTES = 2_000, 100 << 20
"""Files, folders and bytes of a hand-in; more is no lab."""
_MOST_NESTED = 3
"""Archives in one another: a course's own, a student's, and one by mistake."""
_LONGEST, _LONGEST_PART = 1_000, 255
"""Bytes of a name with its folders, and of each part of it."""
_CHUNK = 1 << 16
_NEEDS = "`quadctl lab new DIR` writes one"
_SMALLER = "leave out recordings and environments"


class HandIn(Struct, frozen=True):
    """Hand-in by its name in the results, and its folder or file.

    `members`: of a class's export only these entries, each with its name in the hand-in.
    """

    name: str
    path: Path
    members: dict[str, str] | None = None


def is_lab(name: str) -> bool:
    """Return whether a file makes its folder a lab: quad.toml, or a node of the template."""
    return name == LAB or name in SOURCES


def nodes_in(folder: Path) -> dict[str, list[str]]:
    """Return the commands of a student's nodes, from quad.toml in a folder, or without it from the template's.

    Raises Invalid if it is missing or unreadable, names no node, or one that must be ours.
    """
    file = folder / LAB
    tables = {} if file.exists() else _defaults(folder)
    tables = tables or read(file, _NEEDS).get("processes", {})
    if not isinstance(tables, dict) or not tables:
        raise Invalid(
            f"{file} names no node under [processes]", '[processes] safety = "python my_safety.py"'
        )
    for name in tables:
        if name not in NODES:
            raise Invalid(
                f"{file}: processes.{name}: a hand-in has only {' and '.join(NODES)}",
                "remove this process",
            )
    commands = check({"processes": tables}, str(file)).processes
    return {row.name: list(row.command) for row in table(commands) if row.stranger}


def _defaults(folder: Path) -> dict[str, str]:
    commands = read(_TEMPLATE)["processes"]
    return {name: commands[name] for file, name in SOURCES.items() if (folder / file).is_file()}


def unpacked(handin: HandIn, own: Path) -> Path:
    """Copy a hand-in to an empty folder of ours; return the folder in the copy that has its nodes.

    Raises Invalid if it is damaged, too large or ambiguous, or holds what no hand-in needs.
    """
    copy, source, members = _Copy(), handin.path, handin.members
    for number in range(_MOST_NESTED):
        target = own / str(number)
        with reporting(), closing(entries(source)) as found:
            files = copy.add(found, members, target)
        if (home := _home(files)) is not None:
            return target / home
        source, members = target / _archive(files), None
    raise Invalid("it has an archive in an archive in an archive", "hand in the innermost one")


def _home(files: list[PurePosixPath]) -> PurePosixPath | None:
    """Return the outermost folder with a lab; of several as far out the one with quad.toml; None without any."""
    labs = {
        (len(file.parts), file.name != LAB, str(file.parent)) for file in files if is_lab(file.name)
    }
    if not labs:
        return None
    first = min(labs)[:2]
    outermost = sorted(home for *rank, home in labs if (*rank,) == first)
    _require_one(outermost, "labs", "hand in one; grade a class's export by itself")
    return PurePosixPath(outermost[0])


def _archive(files: list[PurePosixPath]) -> PurePosixPath:
    """Return the only archive among the files of a hand-in that has no lab outside it."""
    if not files:
        raise Invalid("it is empty", "hand in the folder of `quadctl lab new`")
    archives = sorted(str(file) for file in files if is_archive(file.name))
    if not archives:
        raise Invalid(
            f"it has neither {LAB} nor {' or '.join(SOURCES)}",
            "hand in the folder of `quadctl lab new`, with the names that it has there",
        )
    _require_one(archives, "archives", "hand in one; grade a class's export by itself")
    return PurePosixPath(archives[0])


def _require_one(names: list[str], what: str, hint: str) -> None:
    if len(names) > 1:
        raise Invalid(f"it has {len(names)} {what}: {', '.join(map(_shown, names[:3]))}", hint)


class _Copy:
    """Copy of a hand-in, of which all archives in one another together have the limits."""

    def __init__(self) -> None:
        self._count = self._bytes = 0
        self._seen: dict[str, tuple[str, bool]] = {}

    def add(
        self, found: Iterable[ArchiveEntry], members: Mapping[str, str] | None, target: Path
    ) -> list[PurePosixPath]:
        """Copy entries to a new folder; return its files, and links to them."""
        target.mkdir(mode=0o700)
        self._seen, links, files = {}, dict[Path, str](), list[PurePosixPath]()
        for entry in found:
            name = entry.name if members is None else members.get(entry.name)
            if name is None:
                continue
            name = encodable(name)
            self._place(_checked(name), is_folder=entry.kind == "folder")
            path = target / name
            if entry.kind == "folder":
                path.mkdir(0o700, parents=True, exist_ok=True)
                continue
            path.parent.mkdir(0o700, parents=True, exist_ok=True)
            files.append(PurePosixPath(name))
            if entry.kind == "link":
                links[path] = encodable(_target(entry))
            elif entry.kind == "file":
                self._write(entry, path)
            else:
                raise Invalid(f"{_shown(name)} is {entry.kind}", "hand in files and folders only")
        _link(links, target)
        return files

    def _place(self, name: str, *, is_folder: bool) -> None:
        """Take the place of an entry and its folders; raise Invalid if another has it, on any system."""
        parts = name.split("/")
        for count in range(1, len(parts) + 1):
            inner = count < len(parts)
            new = "/".join(parts[:count]), inner or is_folder
            if parts[count - 1] == LAB and new[1]:
                raise Invalid(f"{_shown(new[0])} is a folder", f"hand in the file {LAB}")
            old = self._seen.setdefault(unicodedata.normalize("NFC", new[0]).casefold(), new)
            if old is new:
                self._take(entries=1)
            elif old[0] != new[0]:
                names = f"{_shown(old[0])} and {_shown(new[0])}"
                raise Invalid(f"{names} differ in case only", "give them different names")
            elif old[1] != new[1]:
                raise Invalid(f"{_shown(name)} is both a file and a folder", "keep one of them")
            elif not new[1]:
                raise Invalid(f"{_shown(name)} is there twice", "keep one of them")

    def _take(self, entries: int = 0, size: int = 0) -> None:
        self._count, self._bytes = self._count + entries, self._bytes + size
        if self._count > _MOST_FILES or self._bytes > _MOST_BYTES:
            what = f"more than {_MOST_FILES} files or {_MOST_BYTES >> 20} MB are handed in"
            raise Invalid(what, _SMALLER)

    def _write(self, entry: ArchiveEntry, path: Path) -> None:
        # A file is new, so nothing is written through a link.
        with entry.open() as source, path.open("xb") as out:
            while chunk := source.read(_CHUNK):
                self._take(size=len(chunk))
                out.write(chunk)
        path.chmod(0o700 if entry.runs else 0o600)


def _target(link: ArchiveEntry) -> str:
    if link.target is not None:
        return link.target
    with link.open() as opened:
        return os.fsdecode(opened.read(_LONGEST))


def _link(links: Mapping[Path, str], folder: Path) -> None:
    """Make links; raise Invalid for one that leads out of the folder, by whichever way."""
    for path, target in links.items():
        path.symlink_to(target)
    for path in links:
        if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)):
            name = _shown(path.relative_to(folder).as_posix())
            raise Invalid(f"{name} is a link that leads out of it", "hand in the file itself")


def _checked(name: str) -> str:
    """Return a name that stays within its folder, on any system; raise Invalid for another."""
    parts = name.split("/")
    if name.startswith("/") or ".." in parts or re.match("[A-Za-z]:", name):
        raise Invalid(f"{_shown(name)} is outside its folder", "make the archive in that folder")
    if max(len(os.fsencode(part)) for part in parts) > _LONGEST_PART or len(name) > _LONGEST:
        raise Invalid(f"{_shown(name)} is too long a name", "give it a shorter one")
    return name


def encodable(text: str) -> str:
    """Return a name on one line, with escapes for what UTF-8 lacks: two names stay different."""
    return text.replace("\n", "\\n").encode(errors="backslashreplace").decode()


def _shown(name: str) -> str:
    """Return a name, which a student chooses, as a part of one line."""
    text = "".join(each if each.isprintable() else "?" for each in name)
    return text if len(text) <= 80 else f"{text[:77]}..."
