"""The parameter file that `quadctl init` writes: every key with its unit, default and meaning."""

import tomllib
from collections.abc import Iterator
from typing import Any

from msgspec import inspect

from schemas.describe import bounds_text
from schemas.params import Params
from services.runtime.settings import declared, toml
from services.runtime.settings.declared import Section
from services.runtime.settings.params import check

# What the lab's own launch file sets, where it differs from the defaults in code.
_LAB: dict[str, Any] = {"safety.virtual_cage": {"x": 5.0, "y": 5.0, "z": 2.0}}

_HEAD = """\
# The parameters of one run of quadctl: `quadctl up` reads ./quad.toml.
#
# Order: default in code < this file < `--set safety.virtual_cage.x=3` < `quadctl param set`.
# An unknown name, a wrong type or a value out of bounds stops the launch.
"""
_TAIL = """
# Commands to run in place of a node of ours (hub, dynamics, pressure, safety), or besides them.
# They run in this file's folder and are looked after like our own.
[processes]
# safety = "python my_safety.py"
"""


def render() -> str:
    """The file's text."""
    lines = [_HEAD]
    for section in declared.sections():
        if section.name != "processes":
            lines += [*_table(section), ""]
    return "\n".join(lines).rstrip() + "\n" + _TAIL


def lab_params() -> Params:
    """The parameters of that file."""
    return check(tomllib.loads(render()), "the lab's parameters")


def _table(section: Section) -> Iterator[str]:
    yield f"# {section.about}."
    yield f"[{section.name}]"
    for entry in section.entries:
        facts = [entry.unit, f"default {toml.value(entry.default)}", _bounds(entry.type)]
        about = f"{entry.about[:1].upper()}{entry.about[1:]}"
        yield f"# {about}: {', '.join(filter(None, facts))}."
        key = entry.name.rpartition(".")[2]
        yield f"{key} = {toml.value(_LAB.get(entry.name, entry.default))}"


def _bounds(type_: inspect.Type) -> str:
    """The bounds of a value, or those that all members of a table share."""
    if not isinstance(type_, inspect.StructType):
        return bounds_text(type_)
    shared = {bounds_text(field.type) for field in type_.fields}
    return f"each {shared.pop()}" if len(shared) == 1 else ""
