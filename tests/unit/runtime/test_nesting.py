"""Data of strangers are refused from the same depth on, whatever the Python reads."""

from typing import Any

import msgspec
import pytest

from quadctl.services.runtime.nesting import is_too_deep


@pytest.mark.parametrize(("levels", "deep"), [(0, False), (100, False), (101, True), (900, True)])
def test_a_hundred_levels_are_the_most(levels: int, deep: bool):
    lists: Any = 1
    tables: Any = 1
    names: Any = 1
    for _ in range(levels):
        lists, tables, names = [0, lists], {"a": tables, "b": 0}, (names, 0)
    assert is_too_deep(lists) is is_too_deep(tables) is is_too_deep(names) is deep
    assert is_too_deep({names: 0}) is (levels >= 100)


@pytest.mark.parametrize("around", [[[]], [{}], [[], {}] * 60])
@pytest.mark.parametrize(("levels", "deep"), [(97, False), (98, True)])
def test_json_of_many_brackets_is_walked_through(levels: int, deep: bool, around: Any):
    """At the end are three levels more."""
    nested: Any = [around, "[{"]
    for _ in range(levels):
        nested = {"[": nested} if len(str(nested)) % 2 else [nested]
    assert is_too_deep(nested, msgspec.json.encode(nested)) is is_too_deep(nested) is deep
