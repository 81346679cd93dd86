"""Random values of parameters, generated from their declarations."""

from typing import Any

from hypothesis import strategies as st
from msgspec import inspect

from quadctl.services.runtime.params import catalogue


def changed_values() -> st.SearchStrategy[dict[str, Any]]:
    """Return a strategy for some declared parameters, each with a value of its type."""
    leaves = {name: leaf for name, leaf in catalogue.leaves().items() if name != "processes"}
    return st.lists(st.sampled_from(sorted(leaves)), unique=True, max_size=6).flatmap(
        lambda names: st.fixed_dictionaries({name: _value(leaves[name].type) for name in names})
    )


def _value(type_: inspect.Type) -> st.SearchStrategy[Any]:
    match type_:
        case inspect.BoolType():
            return st.booleans()
        case inspect.IntType():
            return st.integers(0, 2**31 - 1)
        case inspect.LiteralType():
            return st.sampled_from(type_.values)
        case inspect.ListType():
            return st.lists(st.text("abc/:'\"\\ #", max_size=9), max_size=3)
        case _:
            return st.floats(0, 1e6)
