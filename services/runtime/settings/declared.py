"""What schemas/params.py says of every parameter, in its order. Pure."""

from collections.abc import Iterator
from typing import Any

from msgspec import Struct, inspect, to_builtins

from schemas.params import FIXED_AT_LAUNCH, LIVE_SWITCHES, Params
from services.runtime.settings.kept import UNSERVED


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
    for field in _fields(Params):
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


def _fields(cls: type[Struct]) -> tuple[inspect.Field, ...]:
    """The fields of a struct, with their types."""
    described = inspect.type_info(cls)
    assert isinstance(described, inspect.StructType)  # noqa: S101 - a Struct is one
    return described.fields


def _sections(name: str, type_: inspect.StructType) -> Iterator[Section]:
    defaults, nested, entries = type_.cls(), [], []
    for field in _fields(type_.cls):
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
