"""Differences of two documents as lines of text."""

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
    if isinstance(recorded, list) and isinstance(found, list) and len(recorded) == len(found):
        return [
            line
            for number, (one, other) in enumerate(zip(recorded, found, strict=True))
            for line in differences(one, other, f"{path}/{number}")
        ]
    same = recorded == found and type(recorded) is type(found)
    return [] if same else [f"{path}: was {recorded!r}, now it is {found!r}"]
