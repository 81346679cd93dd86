"""Catalogue of all parameters with unit and bounds; the template of quad.toml; TOML writing."""

from collections.abc import Iterator, Mapping
from typing import Any

from msgspec import Struct, inspect, to_builtins

from quadctl.schemas.params import FIXED_AT_LAUNCH, LIVE_SWITCHES, Params
from quadctl.schemas.typeinfo import bounds_text, fields
from quadctl.services.runtime.params.names import put, value_of
from quadctl.services.runtime.run_files import UNSERVED


class Entry(Struct, frozen=True):
    """A parameter, or a small table such as the cage described as one parameter."""

    name: str
    type: inspect.Type
    default: Any
    about: str
    unit: str


class Section(Struct, frozen=True):
    """A table of the file, with the parameters directly in it."""

    name: str
    about: str
    entries: tuple[Entry, ...]


def sections() -> Iterator[Section]:
    """Yield every table of the file, each after the table that contains it."""
    for field in fields(Params):
        inner = _bare(field.type)
        if isinstance(inner, inspect.StructType):
            yield from _sections(field.encode_name, inner)
        else:
            about = annotation(field.type, "description")
            entry = Entry(field.encode_name, inner, {}, about, annotation(field.type, "unit"))
            yield Section(field.encode_name, about, (entry,))


def leaves() -> dict[str, Entry]:
    """Return every single value by dotted name; a described table's values share its meaning."""
    return {
        leaf.name: leaf
        for section in sections()
        for entry in section.entries
        for leaf in _leaves(entry)
    }


def declared(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values, by dotted name, that are declared here: a newer node reports more."""
    known = leaves()
    return {
        name: value
        for name, value in values.items()
        if name in known or name.partition(".")[0] in known
    }


def tables() -> dict[str, str]:
    """Return the meaning of every table by dotted name, the described ones included."""
    found = {}
    for section in sections():
        found[section.name] = section.about
        for entry in section.entries:
            if isinstance(entry.type, inspect.StructType):
                found[entry.name] = entry.about
    return found


def fixed_at_launch(name: str) -> bool:
    """Return whether a running system refuses to change the parameter."""
    return name in FIXED_AT_LAUNCH or name.partition(".")[0] in UNSERVED


def live_switch(name: str) -> str:
    """Return the command that changes a launch-only setting in flight; empty if there is none."""
    return LIVE_SWITCHES.get(name, "")


def _sections(name: str, type_: inspect.StructType) -> Iterator[Section]:
    defaults, nested, entries = type_.cls(), [], []
    for field in fields(type_.cls):
        path = f"{name}.{field.encode_name}"
        about, inner = annotation(field.type, "description"), _bare(field.type)
        if isinstance(inner, inspect.StructType) and not about:
            nested.append((path, inner))
            continue
        default = to_builtins(getattr(defaults, field.encode_name))
        entries.append(Entry(path, inner, default, about, annotation(field.type, "unit")))
    first_line = (type_.cls.__doc__ or "").partition("\n")[0].rstrip(".")
    yield Section(name, first_line, tuple(entries))
    for path, inner in nested:
        yield from _sections(path, inner)


def _leaves(entry: Entry) -> Iterator[Entry]:
    if not isinstance(entry.type, inspect.StructType):
        yield entry
        return
    for field in entry.type.fields:
        path, default = f"{entry.name}.{field.encode_name}", entry.default[field.encode_name]
        yield from _leaves(Entry(path, _bare(field.type), default, entry.about, entry.unit))


def annotation(type_: inspect.Type, name: str) -> str:
    """Return a note of a type's Meta, e.g. its `description`; empty without one."""
    if not isinstance(type_, inspect.Metadata):
        return ""
    extra = type_.extra_json_schema if name == "description" else type_.extra
    return str((extra or {}).get(name, ""))


def _bare(type_: inspect.Type) -> inspect.Type:
    return _bare(type_.type) if isinstance(type_, inspect.Metadata) else type_


def value(plain: Any) -> str:
    """Write a value in TOML, as to the right of the `=`."""
    if isinstance(plain, bool):
        return str(plain).lower()
    if isinstance(plain, Mapping):
        pairs = ", ".join(f"{_key(name)} = {value(part)}" for name, part in plain.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    if isinstance(plain, list | tuple):
        return f"[{', '.join(map(value, plain))}]"
    if isinstance(plain, str):
        import json

        # JSON's escapes are valid in TOML; but JSON leaves DEL as it is, which TOML forbids.
        return json.dumps(plain, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(plain)


def word(plain: Any) -> str:
    """Write a value as `param get` prints and `param set` reads it; unambiguous text unquoted."""
    if isinstance(plain, str) and plain and plain.isprintable() and plain.strip() == plain:
        # Unquoted text that begins with a bracket would be read as a table or list.
        return plain if value_of(plain) == plain and plain[0] not in "{[" else value(plain)
    return value(plain)


def document(values: Mapping[str, Any]) -> str:
    """Write a file that sets values by dotted name, each table after the one that contains it."""
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
    is_bare = name.isascii() and name.replace("_", "a").replace("-", "a").isalnum()
    return name if is_bare else value(name)


# Values of the lab's own launch file that differ from the defaults in code.
_LAB: dict[str, Any] = {"safety.virtual_cage": {"x": 5.0, "y": 5.0, "z": 2.0}}

_HEAD = """\
# The parameters of one run of quadctl: `quadctl up` reads ./quad.toml.
#
# Order: default in code < this file < `--set safety.virtual_cage.x=3` < `quadctl param set`.
# An unknown name, a wrong type or a value out of bounds stops the launch.
# The cage is that of the lab's launch file; every other value is the default.
"""
_ZONE = """\
# [[safety.zones]]
# name = "tower"
# kind = "exclusion"
# polygon = [[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]]
# ceiling = 3.0
"""
_TAIL = """
# Commands that replace a node of quadctl (hub, dynamics, pressure, safety), or run beside them.
# They run in this file's folder, and are supervised and restarted like quadctl's own.
[processes]
# safety = "python my_safety.py"
"""


def render() -> str:
    """Return the text of a quad.toml with every parameter."""
    lines = [_HEAD]
    for section in sections():
        if section.name != "processes":
            lines += [*_table(section), ""]
    return "\n".join(lines).rstrip() + "\n" + _TAIL


def lab_params() -> Params:
    """Return the parameters that `render` writes."""
    # Imported here, because `param get` writes TOML but does not read it.
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
        if entry.name == "safety.zones":
            # A list in one line would forbid the tables that a reader may add.
            yield from _ZONE.splitlines()
            continue
        yield f"{key} = {value(_LAB.get(entry.name, entry.default))}"


def _bounds(type_: inspect.Type) -> str:
    """Return the bounds of a value, or the bounds that all members of a table share."""
    if not isinstance(type_, inspect.StructType):
        return bounds_text(type_)
    shared = {bounds_text(field.type) for field in type_.fields}
    return f"each {shared.pop()}" if len(shared) == 1 else ""
