"""Differences of two documents as lines of text."""

from collections.abc import Iterator
from difflib import SequenceMatcher
from typing import Any


def differences(recorded: Any, found: Any, path: str = "") -> list[str]:
    """List where two documents differ, each with its path; the order of names counts."""
    if isinstance(recorded, dict) and isinstance(found, dict):
        lines = [f"{path}/{name}: is missing" for name in recorded if name not in found]
        lines += [f"{path}/{name}: is new" for name in found if name not in recorded]
        if not lines and list(recorded) != list(found):
            lines = [f"{path}: the order was {[*recorded]}, now it is {[*found]}"]
        for name in recorded:
            if name in found:
                lines += differences(recorded[name], found[name], f"{path}/{name}")
        return lines
    if isinstance(recorded, list) and isinstance(found, list):
        return [*_of_lists(recorded, found, path)]
    same = recorded == found and type(recorded) is type(found)
    return [] if same else [f"{path}: was {recorded!r}, now it is {found!r}"]


def _of_lists(recorded: list[Any], found: list[Any], path: str) -> Iterator[str]:
    """Yield the elements that are missing or new, and the differences of those in the same place."""
    old, new = ([repr(each) for each in side] for side in (recorded, found))
    for _, a, b, c, d in SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        if b - a == d - c:
            for number in range(b - a):
                yield from differences(
                    recorded[a + number], found[c + number], f"{path}/{a + number}"
                )
            continue
        yield from (f"{path}/{n}: {old[n]} is missing" for n in range(a, b))
        yield from (f"{path}/{n}: {new[n]} is new" for n in range(c, d))
