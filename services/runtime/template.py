"""The parameter file that `quadctl init` writes: every key with its unit, default and meaning."""

import tomllib
from collections.abc import Iterator
from typing import Any

from msgspec import Struct, inspect, to_builtins

from schemas.describe import bounds_text
from schemas.params import Params
from services.runtime.params import check

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
    for field in _fields(Params):
        if isinstance(_bare(field.type), inspect.StructType):
            lines += [*_table(field.encode_name, _bare(field.type)), ""]
    return "\n".join(lines).rstrip() + "\n" + _TAIL


def lab_params() -> Params:
    """The parameters of that file."""
    return check(tomllib.loads(render()), "the lab's parameters")


def _table(name: str, type_: Any) -> Iterator[str]:
    yield f"# {_first_line(type_.cls)}."
    yield f"[{name}]"
    nested = []
    for field in _fields(type_.cls):
        about, inner = _about(field.type), _bare(field.type)
        if isinstance(inner, inspect.StructType) and not about:
            nested.append((f"{name}.{field.encode_name}", inner))
            continue
        default = to_builtins(getattr(type_.cls(), field.encode_name))
        value = _LAB.get(f"{name}.{field.encode_name}", default)
        facts = [_unit(field.type), f"default {_toml(default)}", _bounds(inner)]
        yield f"# {about[:1].upper()}{about[1:]}: {', '.join(filter(None, facts))}."
        yield f"{field.encode_name} = {_toml(value)}"
    for path, inner in nested:
        yield ""
        yield from _table(path, inner)


def _about(type_: inspect.Type) -> str:
    """A parameter's meaning; a table that has none is written as a table of its own."""
    described = isinstance(type_, inspect.Metadata) and type_.extra_json_schema
    return str(described["description"]) if described else ""


def _unit(type_: inspect.Type) -> str:
    described = isinstance(type_, inspect.Metadata) and type_.extra
    return str(described["unit"]) if described else ""


def _bounds(type_: inspect.Type) -> str:
    """The bounds of a value, or those that all members of a table share."""
    if not isinstance(type_, inspect.StructType):
        return bounds_text(type_)
    shared = {bounds_text(_bare(field.type)) for field in type_.fields}
    return f"each {shared.pop()}" if len(shared) == 1 else ""


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(part)}" for key, part in value.items()) + " }"
    if isinstance(value, str):
        return f'"{value}"'
    return repr(value)


def _bare(type_: inspect.Type) -> inspect.Type:
    return _bare(type_.type) if isinstance(type_, inspect.Metadata) else type_


def _fields(cls: type[Struct]) -> tuple[inspect.Field, ...]:
    described = inspect.type_info(cls)
    assert isinstance(described, inspect.StructType)  # noqa: S101 - a Struct is one
    return described.fields


def _first_line(cls: type) -> str:
    return (cls.__doc__ or "").partition("\n")[0].rstrip(".")
