"""The measurement of the machine's stalls counts each moment once."""

import os

import pytest

from tests.support.sleeper import Sleeper


def test_stalls_of_several_processors_count_once_where_they_overlap():
    sleeper = Sleeper()
    sleeper.stop()
    sleeper._stalls = [(10.0, 12.0), (11.0, 11.5), (11.8, 13.0), (20.0, 21.0)]
    assert sleeper.within(0.0, 30.0) == pytest.approx(4.0)
    assert sleeper.within(11.0, 11.9) == pytest.approx(0.9)
    assert sleeper.within(12.5, 20.5) == pytest.approx(1.0)
    assert sleeper.within(14.0, 19.0) == 0.0


def test_a_thread_sleeps_on_each_processor():
    before = os.sched_getaffinity(0)
    sleeper = Sleeper()
    assert len(sleeper._threads) == len(before)
    assert os.sched_getaffinity(0) == before
    assert "a processor stalled" in sleeper.stop()
