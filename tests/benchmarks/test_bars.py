import pytest
from hypothesis import given, strategies as st

from benchmarks.bars import AtLeast, AtMost, AtMostTimes, judge, percentile, summarise

NUMBERS = st.lists(st.floats(0.001, 1e6), min_size=1)


def figure(*runs, missing=None, error="", more_is_better=False):
    return summarise(runs, missing or {}, error, more_is_better=more_is_better)


@given(NUMBERS)
def test_percentiles_are_measured_values_in_order(values):
    low, middle, high = (percentile(values, part) for part in (0.01, 0.5, 0.99))
    assert min(values) <= low <= middle <= high <= max(values)
    assert {low, middle, high} <= set(values)


def test_the_tail_is_the_bad_one():
    run = {"ours": range(1, 101)}
    assert figure(run).sides["ours"].tail == 99
    assert figure(run, more_is_better=True).sides["ours"].tail == 2


def test_the_ratio_is_the_median_of_the_runs_ratios():
    runs = [
        {"ours": [2, 2, 9], "raw": [1, 2, 3]},
        {"ours": [30], "raw": [10]},
        {"ours": [5], "raw": [4]},
    ]
    found = figure(*runs)
    assert found.ratios["raw"] == [1.0, 3.0, 1.25]
    assert found.ratio("raw") == 1.25
    assert found.ratio("ros") is None


@pytest.mark.parametrize(
    ("bar", "verdict"),
    [
        (AtMost(10), "holds"),
        (AtMost(9.9), "missed"),
        (AtLeast(10), "holds"),
        (AtLeast(10.1), "missed"),
        (AtMostTimes(2, "raw"), "holds"),
        (AtMostTimes(1.9, "raw"), "missed"),
        (AtMostTimes(2, "ros"), "not compared"),
    ],
)
def test_a_bar_judges_our_median(bar, verdict):
    assert judge(figure({"ours": [9, 10, 99], "raw": [5]}), [bar]) == verdict


def test_without_a_peer_the_absolute_bar_still_counts():
    alone = figure({"ours": [10]}, missing={"ros": "not installed"})
    bars = [AtMost(9), AtMostTimes(0.5, "ros")]
    assert judge(alone, bars) == "missed"
    assert judge(alone, [AtMost(10), bars[1]]) == "not compared"


def test_a_row_without_measurements_has_failed():
    assert judge(figure(error="it broke"), [AtMost(1)]) == "failed"
    assert judge(figure({"ours": [1]}, error="it broke"), [AtMost(1)]) == "failed"
    assert judge(figure({"raw": [1]}), []) == "failed"


def test_the_text_of_a_bar():
    # docs/figures.md has the others.
    assert AtMost(0).text("") == "<= 0"
    assert AtLeast(100_000).text("/s") == ">= 100000 /s"
    assert AtMostTimes(1.2, "raw").text("us") == "<= 1.2 x raw Zenoh"
