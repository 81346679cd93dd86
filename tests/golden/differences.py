"""Where two documents differ, told in lines."""

from typing import Any


def differences(recorded: Any, found: Any, path: str = "") -> list[str]:
    """List where two documents differ, each with its path; the order of names counts."""
    if isinstance(recorded, dict) and isinstance(found, dict):
        told = [f"{path}/{name}: is gone" for name in recorded if name not in found]
        told += [f"{path}/{name}: is new" for name in found if name not in recorded]
        if not told and list(recorded) != list(found):
            told = [f"{path}: the order was {[*recorded]}, and is {[*found]}"]
        for name in recorded:
            if name in found:
                told += differences(recorded[name], found[name], f"{path}/{name}")
        return told
    if isinstance(recorded, list) and isinstance(found, list) and len(recorded) == len(found):
        return [
            line
            for number, (one, other) in enumerate(zip(recorded, found, strict=True))
            for line in differences(one, other, f"{path}/{number}")
        ]
    same = recorded == found and type(recorded) is type(found)
    return [] if same else [f"{path}: was {recorded!r}, and is {found!r}"]
