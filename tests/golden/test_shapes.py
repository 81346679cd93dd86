"""The --json output of every command has the recorded keys and types; the tokens are as recorded."""

import pytest

from tests.golden import data, shapes
from tests.golden.differences import differences
from tests.support.compiled import compiled_kernel
from tests.support.lab import private_lab


@pytest.mark.thorough
def test_json_output_has_the_recorded_shapes():
    compiled_kernel()
    with private_lab() as lab:
        found = shapes.gather(lab)
    told = differences(data.read("shapes"), data.plain(found))
    assert not told, "\n".join([*told, data.HOW])
