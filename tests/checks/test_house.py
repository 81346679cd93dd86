"""House checks of the tree; test_checks_can_fail.py covers the types, which take long."""

import pytest

from tests.checks import house


@pytest.mark.thorough
@pytest.mark.parametrize("check", [name for name in house.CHECKS if name != "types"])
def test_the_tree_passes(check):
    if found := house.CHECKS[check](house.ROOT):
        pytest.fail(found, pytrace=False)
