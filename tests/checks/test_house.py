"""The tree passes every house check; what takes long, the types, test_checks_can_fail looks at."""

import pytest

from tests.checks import house


@pytest.mark.parametrize("check", [name for name in house.CHECKS if name != "types"])
def test_the_tree_passes(check):
    if found := house.CHECKS[check](house.ROOT):
        pytest.fail(found, pytrace=False)
