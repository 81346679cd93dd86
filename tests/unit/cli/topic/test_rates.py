"""The figures of `topic hz`, `bw` and `delay`."""

import math

import pytest
from hypothesis import given, strategies as st

from quadctl.cli.topic.rates import Arrival, _arrival, bandwidth, delay_figures, rate
from quadctl.services.runtime.bus.streams import RawMessage
from quadctl.services.runtime.errors import Invalid

TIMES = (10.0, 10.1, 10.2, 10.4)
ARRIVALS = [
    Arrival(at, size, age)
    for at, size, age in zip(TIMES, (8, 10, 20, 30), (1, 2, 3, 2), strict=True)
]


def test_the_rate_is_printed_as_in_rostopic():
    found = rate(ARRIVALS)
    assert found.document["hz"] == pytest.approx(7.5)
    assert found.document["std"] == pytest.approx(math.sqrt(2) / 30)
    assert (found.document["min"], found.document["max"]) == pytest.approx((0.1, 0.2))
    assert found.text == (
        "average rate: 7.500\n\tmin: 0.100s max: 0.200s std dev: 0.04714s window: 4"
    )
    assert list(found.document) == ["hz", "min", "max", "std", "n"]


def test_the_bandwidth_covers_the_measured_time():
    found = bandwidth(ARRIVALS)
    assert found.document["bytes_per_second"] == pytest.approx(60 / 0.4)
    assert (found.document["mean"], found.document["min"], found.document["max"]) == (17, 8, 30)
    assert found.text == "average: 150.00B/s\n\tmean: 17.00B min: 8.00B max: 30.00B window: 4"
    many = [Arrival(received=at / 1000, size=2_500, age=0) for at in range(1001)]
    assert bandwidth(many).text.startswith("average: 2.50MB/s\n\tmean: 2.50KB")


def test_the_delay_is_measured():
    found = delay_figures(ARRIVALS)
    assert found.document == {"delay": 2, "min": 1, "max": 3, "std": math.sqrt(0.5), "n": 4}
    assert found.text.startswith("average delay: 2.000000\n\tmin: 1.000000s")


@given(st.lists(st.floats(0, 1e6), min_size=2, max_size=50).map(sorted))
def test_any_arrival_times_give_finite_figures(times: list[float]):
    figures = [
        measure([Arrival(at, 5, at) for at in times])
        for measure in (rate, bandwidth, delay_figures)
    ]
    for found in figures:
        assert all(math.isfinite(value) for value in found.document.values())
        assert found.document["min"] <= found.document["max"]


def test_a_message_without_a_time_has_no_delay():
    message = RawMessage("a/b", b"xyz", "", 1_500_000_000, 0)
    assert _arrival(message, aged=False) == Arrival(1.5, 3, 0.0)
    with pytest.raises(Invalid, match="has no time stamp"):
        _arrival(message, aged=True)
