"""Contracts of the releases, kept in `kept/VERSION`, and what of them is missing today.

`python -m tests.golden.keep VERSION` writes such a folder when a version is released. Nothing writes
it again.
"""

import json
import re
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any

KEPT = Path(__file__).parent / "kept"
DOCUMENTS = ("keys", "messages", "commands", "parameters", "names", "shapes", "python")
"""Recorded files of which releases keep what they promise."""


def promised(name: str, content: Any) -> Any:
    """Return the part of a recorded file that stays; defaults of parameters, e.g., may change."""
    match name:
        case "commands":
            return {part: content[part] for part in ("common", "commands")}
        case "parameters":
            found = {each["name"]: each for each in content["parameters"]}
            return {
                leaf: {
                    "type": each["type"],
                    "unit": each["unit"],
                    "bounds": _choices(each["bounds"]),
                }
                for leaf, each in found.items()
            }
        case "names":
            return {part: content[part] for part in content if part != "environment"}
        case "shapes":
            return {part: content[part] for part in ("offline", "looking", "acting")}
    return content


def _choices(bounds: Any) -> Any:
    """Return the choices of a text as a list, which may become longer; other bounds as they are."""
    is_choice = isinstance(bounds, str) and re.fullmatch(r"[\w-]+(\|[\w-]+)+", bounds)
    return bounds.split("|") if is_choice else bounds


def compact(content: Any) -> str:
    """Return JSON with a line for each name at the top."""
    rows = (
        f"{json.dumps(name)}: {json.dumps(part, separators=(',', ':'), ensure_ascii=False)}"
        for name, part in content.items()
    )
    return "{\n" + ",\n".join(rows) + "\n}\n"


def releases() -> list[str]:
    """Return the kept versions, the newest first."""
    found = (folder.name for folder in KEPT.iterdir() if folder.is_dir())
    return sorted(found, key=lambda name: [int(part) for part in name.split(".")], reverse=True)


def document(version: str, name: str) -> Any:
    """Read a kept document."""
    return json.loads((KEPT / version / f"{name}.json").read_text(encoding="utf-8"))


def lost(kept: Any, now: Any, path: str = "") -> Iterator[str]:
    """Yield all of a kept document that is missing or different today; more is welcome."""
    if isinstance(kept, dict) and isinstance(now, dict):
        for name, part in kept.items():
            if name in now:
                yield from lost(part, now[name], f"{path}/{name}")
            else:
                yield f"{path}/{name}: is missing"
    elif isinstance(kept, list) and isinstance(now, list):
        for part in kept:
            if not any(not [*lost(part, each)] for each in now):
                yield f"{path}: {part!r} is missing"
    elif kept != now or type(kept) is not type(now):
        yield f"{path}: was {kept!r}, now it is {now!r}"


def missing(version: str, name: str, now: Any) -> list[str]:
    """Return what a release promised in a document and today's content of it does not have."""
    return [*lost(document(version, name), promised(name, now))]


def broken(name: str, kept: dict[str, Any], now: dict[str, Any], *, sent_alone: bool) -> list[str]:
    """Return why a type on the wire does not follow its kept version; nothing if it does.

    It may gain fields at its end, with defaults. A type that refuses unknown fields has to leave out
    those at their defaults, and cannot gain any as a part of another (if it is not `sent_alone`).
    """
    if name not in now:
        return [f"{name} is missing"]
    old, new = kept[name], now[name]
    count = len(old["fields"])
    found, more = [], new["fields"][count:]
    for was, field in zip_longest(old["fields"], new["fields"][:count]):
        if field is None or was.keys() != field.keys() or [*lost(was, field)]:
            found.append(f"{name}.{was['name']}: was {was}, now it is {field}")
    found += [f"{name}.{field['name']} has no default" for field in more if "default" not in field]
    if old["forbid_unknown_fields"] != new["forbid_unknown_fields"]:
        found.append(f"{name}: forbid_unknown_fields is another")
    if more and old["forbid_unknown_fields"]:
        if not sent_alone:
            found.append(f"{name} gains a field, and older readers of what contains it refuse that")
        elif not new["omit_defaults"]:
            found.append(f"{name} gains a field: declare it with omit_defaults=True")
    elif old["omit_defaults"] != new["omit_defaults"]:
        found.append(f"{name}: omit_defaults is another")
    return found
