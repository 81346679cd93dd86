"""Catalogue of all parameters with unit and bounds; the template of quad.toml; TOML writing."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from msgspec import Struct, inspect, to_builtins

from quadctl.schemas.params import FIXED_AT_LAUNCH, LIVE_SWITCHES, Params
from quadctl.schemas.typeinfo import bounds_text, fields
from quadctl.services.runtime.params.names import put, value_of
from quadctl.services.runtime.run_files import UNSERVED


class Entry(Struct, frozen=True):
    """A parameter, or a small table such as the cage that is described as one.

    `type` and `default` are of that; `about` is its meaning.
    """

    name: str
    type: inspect.Type
    default: Any
    about: str
    unit: str


class Section(Struct, frozen=True):
    """A table of the file, with the parameters that stand in it."""

    name: str
    about: str
    entries: tuple[Entry, ...]


def sections() -> Iterator[Section]:
    """Every table of the file, each after the one that it stands in."""
    for field in fields(Params):
        inner = _bare(field.type)
        if isinstance(inner, inspect.StructType):
            yield from _sections(field.encode_name, inner)
        else:
            about = _said(field.type, "description")
            entry = Entry(field.encode_name, inner, {}, about, _said(field.type, "unit"))
            yield Section(field.encode_name, about, (entry,))


def leaves() -> dict[str, Entry]:
    """Every single value by its dotted name; inside a described table it has that one's meaning."""
    return {
        leaf.name: leaf
        for section in sections()
        for entry in section.entries
        for leaf in _leaves(entry)
    }


def tables() -> dict[str, str]:
    """The meaning of every table by its dotted name, the described ones among them."""
    found = {}
    for section in sections():
        found[section.name] = section.about
        for entry in section.entries:
            if isinstance(entry.type, inspect.StructType):
                found[entry.name] = entry.about
    return found


def fixed_at_launch(name: str) -> bool:
    """Whether a running system refuses to change it."""
    return name in FIXED_AT_LAUNCH or name.partition(".")[0] in UNSERVED


def live_switch(name: str) -> str:
    """The command that changes at once what a parameter fixes at launch alone; mostly none."""
    return LIVE_SWITCHES.get(name, "")


def _sections(name: str, type_: inspect.StructType) -> Iterator[Section]:
    defaults, nested, entries = type_.cls(), [], []
    for field in fields(type_.cls):
        path = f"{name}.{field.encode_name}"
        about, inner = _said(field.type, "description"), _bare(field.type)
        if isinstance(inner, inspect.StructType) and not about:
            nested.append((path, inner))
            continue
        default = to_builtins(getattr(defaults, field.encode_name))
        entries.append(Entry(path, inner, default, about, _said(field.type, "unit")))
    first_line = (type_.cls.__doc__ or "").partition("\n")[0].rstrip(".")
    yield Section(name, first_line, tuple(entries))
    for path, inner in nested:
        yield from _sections(path, inner)


def _leaves(entry: Entry) -> Iterator[Entry]:
    if not isinstance(entry.type, inspect.StructType):
        yield entry
        return
    for field in entry.type.fields:
        name = field.encode_name
        default = entry.default[name]
        path = f"{entry.name}.{name}"
        yield from _leaves(Entry(path, _bare(field.type), default, entry.about, entry.unit))


def _said(type_: inspect.Type, what: str) -> str:
    if not isinstance(type_, inspect.Metadata):
        return ""
    said = type_.extra_json_schema if what == "description" else type_.extra
    return str((said or {}).get(what, ""))


def _bare(type_: inspect.Type) -> inspect.Type:
    return _bare(type_.type) if isinstance(type_, inspect.Metadata) else type_


_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def value(said: Any) -> str:
    """A value as it stands right of a `=` in a file."""
    if isinstance(said, bool):
        return str(said).lower()
    if isinstance(said, Mapping):
        pairs = ", ".join(f"{_key(name)} = {value(part)}" for name, part in said.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    if isinstance(said, list | tuple):
        return f"[{', '.join(map(value, said))}]"
    if isinstance(said, str):
        import json

        # JSON's escapes are TOML's as well; of the control characters it leaves DEL alone.
        return json.dumps(said, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(said)


def word(said: Any) -> str:
    """A value as `param get` prints it and `param set` takes it: text as it is where that is clear."""
    if isinstance(said, str) and said and said.isprintable() and said.strip() == said:
        # A text that begins as a table or list would be read as one, in another notation.
        plain = value_of(said) == said and said[0] not in "{["
        return said if plain else value(said)
    return value(said)


def document(values: Mapping[str, Any]) -> str:
    """A file that sets values by dotted name, a table after the one that it stands in."""
    tables: dict[str, Any] = {}
    for name, part in values.items():
        put(tables, name, part, "the file")
    return "\n\n".join("\n".join(lines) for lines in _tables(tables, "")) + "\n"


def _tables(table: Mapping[str, Any], path: str) -> Iterator[list[str]]:
    values = {name: part for name, part in table.items() if not isinstance(part, Mapping)}
    if values:
        head = [f"[{path}]"] if path else []
        yield [*head, *(f"{_key(name)} = {value(part)}" for name, part in values.items())]
    for name, part in table.items():
        if isinstance(part, Mapping):
            yield from _tables(part, f"{path}.{_key(name)}".lstrip("."))


def _key(name: str) -> str:
    return name if _BARE_KEY.fullmatch(name) else value(name)


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
    for section in sections():
        if section.name != "processes":
            lines += [*_table(section), ""]
    return "\n".join(lines).rstrip() + "\n" + _TAIL


def lab_params() -> Params:
    """The parameters of that file."""
    # Imported here: `param get` writes values in TOML, and reads none.
    import tomllib

    from quadctl.services.runtime.params.load import check

    return check(tomllib.loads(render()), "the lab's parameters")


def _table(section: Section) -> Iterator[str]:
    yield f"# {section.about}."
    yield f"[{section.name}]"
    for entry in section.entries:
        facts = [entry.unit, f"default {value(entry.default)}", _bounds(entry.type)]
        about = f"{entry.about[:1].upper()}{entry.about[1:]}"
        yield f"# {about}: {', '.join(filter(None, facts))}."
        key = entry.name.rpartition(".")[2]
        yield f"{key} = {value(_LAB.get(entry.name, entry.default))}"


def _bounds(type_: inspect.Type) -> str:
    """The bounds of a value, or those that all members of a table share."""
    if not isinstance(type_, inspect.StructType):
        return bounds_text(type_)
    shared = {bounds_text(field.type) for field in type_.fields}
    return f"each {shared.pop()}" if len(shared) == 1 else ""
