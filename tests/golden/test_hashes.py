"""Flights and campaigns have the recorded hashes, to the bit."""

import pytest

from tests.golden import data, hashes
from tests.golden.differences import differences
from tests.support.compiled import compiled_kernel
from tests.support.lab import private_lab

RECORDED = data.read("hashes")


@pytest.mark.thorough
@pytest.mark.needs("rounding")
def test_flights_and_campaigns_have_the_recorded_hashes():
    compiled_kernel()
    with private_lab() as lab:
        told = differences(RECORDED, data.plain(hashes.gather(lab)))
    assert not told, "\n".join(told)
