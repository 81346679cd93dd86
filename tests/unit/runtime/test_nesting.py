"""Data of strangers are refused from the same depth on, whatever the Python reads."""

from typing import Any

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
