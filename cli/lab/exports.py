"""Exports of a class by Moodle, Canvas and Gradescope, and archives of hand-ins: the hand-in of each student."""

import json
import re
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from quadctl.cli.lab.archives import entries, is_archive, reporting
from quadctl.cli.lab.handin import HandIn, encodable, is_lab
from quadctl.services.runtime.errors import Invalid

_MOODLE = re.compile(r"(?P<student>.+)_assignsubmission_[a-z]+(?:_(?P<file>.*))?")
"""Outermost name in Moodle's export: a student's folder, or with `file` one of the files."""
_CANVAS = re.compile(
    r"(?:(?!LATE_)(?P<student>\w+?)_)?(?:LATE_)?(?P<id>\d+|anon_[^_]+)_(?:\d+_(?P<file>.+)|(?:text|link)\.html)"
)
"""File in Canvas's export, by its student and the student's number."""
_ANEW = re.compile(r"-\d+(?=\.(?:py|toml)$)")
"""Number that Canvas adds to the name of a file that is handed in anew."""
_GRADESCOPE = re.compile(r"submission_\w+")
_METADATA = "submission_metadata.yml"
_MOST_METADATA = 64 << 20
_SUBMITTER = re.compile(r" +(?:- )?:name: *(.+)")

Students = dict[str, dict[str, str]]
"""Students, each with the names of the entries, and those that they have in the hand-in."""


class _Place(NamedTuple):
    """Entry in a level of an export: its outermost name there, the rest of it, its kind and full name."""

    top: str
    rest: str
    kind: str
    name: str


def handins_in(path: Path) -> list[HandIn]:
    """Return the hand-ins of the class that a folder or an archive clearly holds, else it as one hand-in."""
    students: Students = {}
    with suppress(Invalid), reporting():  # the copy of a damaged one reports it
        students = _students(path)
    if not students:
        return [HandIn(encodable(str(path)), path)]
    return [
        HandIn(encodable(f"{path}/{student.replace('/', '_')}"), path, members)
        for student, members in sorted(students.items())
    ]


def _students(path: Path) -> Students:
    level, metadata = list[_Place](), ""
    for entry in entries(path):
        top, _, rest = entry.name.partition("/")
        level.append(_Place(top, rest, entry.kind, entry.name))
        if Path(entry.name).name == _METADATA and entry.kind == "file":
            with entry.open() as opened:
                metadata = opened.read(_MOST_METADATA).decode(errors="replace")
    return _in_level(level, metadata) or _in_level(_inner(level), metadata)


def _inner(level: Sequence[_Place]) -> list[_Place]:
    """Return the level in the only folder of a level; none if there is more beside it."""
    inside = [each for each in level if each.rest]
    if len({each.top for each in level}) != 1 or any(
        each.kind != "folder" for each in level if not each.rest
    ):
        return []
    return [
        each._replace(top=each.rest.partition("/")[0], rest=each.rest.partition("/")[2])
        for each in inside
    ]


def _in_level(level: Sequence[_Place], metadata: str) -> Students:
    return _gradescope(level, metadata) or _moodle(level) or _canvas(level) or _others(level)


def _gradescope(level: Sequence[_Place], metadata: str) -> Students:
    if not any(each.top == _METADATA for each in level):
        return {}
    names = _submitters(metadata)
    found: Students = {key: {} for key in names}
    for each in level:
        if _GRADESCOPE.fullmatch(each.top) and each.top != _METADATA:
            _add(found, each.top, each, each.rest)
    labels = {key: ", ".join(names.get(key, [])) for key in found}
    times = Counter(labels.values())
    return {
        label if label and times[label] == 1 else f"{label} {key}".strip(): found[key]
        for key, label in labels.items()
    }


def _submitters(metadata: str) -> dict[str, list[str]]:
    """Return the names of each submission's students, in the form in which Gradescope writes YAML."""
    found: dict[str, list[str]] = {}
    key, inside = "", False
    for line in metadata.splitlines():
        if line[:1] not in {"", " ", "-"}:
            key, inside = line.partition(":")[0], False
            if _GRADESCOPE.fullmatch(key):
                found[key] = []
        elif re.match(r" {2}:\w+:", line):
            inside = line.startswith("  :submitters:")
        elif inside and key in found and (named := _SUBMITTER.fullmatch(line)):
            found[key].append(_scalar(named[1].strip()))
    return found


def _scalar(text: str) -> str:
    """Return a scalar of YAML without its quotes."""
    if text.startswith('"'):
        with suppress(ValueError):
            return str(json.loads(text))
    return text[1:-1].replace("''", "'") if text.startswith("'") else text


def _moodle(level: Sequence[_Place]) -> Students:
    found: Students = {}
    for each in level:
        if not (match := _MOODLE.fullmatch(each.top)):
            return {}
        _add(found, match["student"], each, "/".join(filter(None, (match["file"], each.rest))))
    return found


def _canvas(level: Sequence[_Place]) -> Students:
    found: Students = {}
    for each in level:
        if each.rest or each.kind != "file" or not (match := _CANVAS.fullmatch(each.top)):
            return {}
        student = "_".join(filter(None, (match["student"], match["id"])))
        _add(found, student, each, _ANEW.sub("", match["file"] or "text.html"))
    return found


def _others(level: Sequence[_Place]) -> Students:
    """Return the folders and archives of a level in which several are hand-ins by themselves."""
    found: Students = {}
    labs = set[str]()
    for each in level:
        if not each.rest and is_lab(each.top):
            return {}
        if each.rest or each.kind != "file" or is_archive(each.top):
            _add(found, each.top, each, each.rest)
        name = Path(each.name).name
        if each.kind == "file" and (is_archive(name) or (each.rest and is_lab(name))):
            labs.add(each.top)
    archives = sum(map(is_archive, labs))
    return found if max(archives, len(labs) - archives) > 1 else {}


def _add(students: Students, student: str, place: _Place, name: str) -> None:
    """Add an entry to a student's hand-in; a folder that is the hand-in itself is no entry of it."""
    members = students.setdefault(student, {})
    if name or place.kind != "folder":
        members[place.name] = name or place.top
