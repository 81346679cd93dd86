"""The parameters by table, each with its way of editing. Pure."""

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from msgspec import Struct, inspect

from quadctl.schemas.typeinfo import bounds_text, type_name
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.catalogue import Entry, fixed_at_launch
from quadctl.services.runtime.params.names import value_of

Way = Literal["switch", "choice", "text"]


class Setting(Struct, frozen=True):
    """One parameter: `way` is its kind of field, `choices` the values to choose from."""

    name: str
    label: str
    way: Way
    choices: tuple[str, ...]
    facts: str
    about: str
    fixed: bool

    def read(self, entered: Any) -> Any:
        """Return the value typed or chosen; raise Invalid if it is empty."""
        if self.way != "text":
            return entered
        text = str(entered).strip()
        if not text:
            raise Invalid(f"{self.name}: the value is empty", self.facts)
        return value_of(text)


class Table(Struct, frozen=True):
    """Table of the parameter file."""

    name: str
    about: str
    settings: tuple[Setting, ...]


def tables(values: Mapping[str, Any]) -> list[Table]:
    """Return every table of the file, then those that only a user's own nodes have."""
    leaves = catalogue.leaves()
    found: dict[str, list[Setting]] = {}
    descriptions = {section.name: section.about for section in catalogue.sections()}
    for section in catalogue.sections():
        own = [
            _setting(leaf, section.name)
            for entry in section.entries
            for leaf in leaves.values()
            if leaf.name == entry.name or leaf.name.startswith(f"{entry.name}.")
        ]
        if own:
            found[section.name] = own
    for name in values:
        if name not in leaves:
            node = name.partition(".")[0]
            descriptions.setdefault(node, f"of the node {node}")
            found.setdefault(node, []).append(
                Setting(name, name.removeprefix(f"{node}."), "text", (), "", "", fixed=False)
            )
    return [Table(name, descriptions[name], tuple(own)) for name, own in found.items()]


def shown(value: Any) -> str:
    """Return a value as a user types it."""
    return value if isinstance(value, str) and value else catalogue.word(value)


def _setting(leaf: Entry, table: str) -> Setting:
    way: Way = "text"
    choices: tuple[str, ...] = ()
    match leaf.type:
        case inspect.BoolType():
            way = "switch"
        case inspect.LiteralType():
            way, choices = "choice", tuple(str(value) for value in leaf.type.values)
    label, facts = leaf.name.removeprefix(f"{table}."), " · ".join(_facts(leaf, way))
    return Setting(leaf.name, label, way, choices, facts, leaf.about, fixed_at_launch(leaf.name))


def _facts(leaf: Entry, way: Way) -> Iterator[str]:
    if way == "text":
        yield f"{bounds_text(leaf.type)} {leaf.unit}".strip() or type_name(leaf.type)
    yield f"default {catalogue.word(leaf.default)}"
    if fixed_at_launch(leaf.name):
        yield "set at launch"
