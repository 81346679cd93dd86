"""Benchmark of the flight model: tables and bars from its figures."""

import pytest

from benchmarks.model import scenario
from benchmarks.model.figures import BARS, PAIRED, RUNNERS, Bar, tables
from benchmarks.model.flops import step_flops
from benchmarks.model.flown import fly
from benchmarks.model.peers import timing
from benchmarks.model.peers.mujoco_model import xml


@pytest.mark.parametrize(
    ("theirs", "verdict"), [(100.0, "holds"), (101.0, "missed"), (None, "not compared")]
)
def test_a_bar_is_a_ratio_of_one_run(theirs, verdict):
    bar = Bar("plain", 1, 40, "rotorpy", 1)
    rates = {"plain": {"dynamics": {"1": 4000.0}}}
    if theirs:
        rates["rotorpy"] = {"dynamics": {"1": theirs}}
    assert bar.verdict(rates, {}) == verdict


@pytest.mark.parametrize(("ratio", "verdict"), [(0.9, "holds"), (0.89, "missed")])
def test_interleaved_ratio_counts_before_separate_measurements(ratio, verdict):
    rates = {key: {"dynamics": {"10000": 1.0}} for key in (PAIRED.ours, PAIRED.peer)}
    assert PAIRED.verdict(rates, {PAIRED.key: ratio}) == verdict


def test_a_ratio_in_turn_cancels_the_speed_of_each_turn(monkeypatch: pytest.MonkeyPatch):
    # A processor that is half as fast in every other turn; ours takes 2 s where theirs takes 3.
    clock, runs = [0.0], [0]

    def side(seconds: float):
        def run(calls: int) -> None:
            runs[0] += 1
            clock[0] += calls * seconds * (1 + (runs[0] - 1) // 2 % 2)

        return run

    monkeypatch.setattr("time.process_time", lambda: clock[0])
    assert timing.in_turn(side(2.0), side(3.0)) == 1.5


def test_the_table_has_a_line_for_each_and_names_missing_peers():
    rates = {"plain": {"1": 1e5}, "compiled": {"1": 1e6, "10000": 3e7}}
    lines = tables({
        "machine": {"processor": "2 x Abacus", "python": "3.11", "date": "2026-11-21",
                    "commit": "0a1b2c3", "load": 0.5},
        "flops": 700, "peak": 70.0, "paired": {},
        "rates": {key: {"dynamics": found} for key, found in rates.items()},
        "imports": dict.fromkeys(rates, 0.1), "memory": dict.fromkeys(rates, 12.0),
        "versions": dict.fromkeys(rates, "1.0"),
        "missing": {r.key: "not installed" for r in RUNNERS if r.key not in rates},
    }).splitlines()  # fmt: skip
    assert "| quadctl, plain Python | double, RK4 | 100 k |" in lines[2]
    assert "30 M |" in lines[3]
    assert "30 % |" in lines[3]  # 3e7 steps of 700 operations, of 70 GFLOP/s
    assert "not installed" in lines[5]
    assert len({line.count("|") for line in lines[: 2 + len(RUNNERS)]}) == 1
    assert sum("not compared" in line for line in lines) == len(BARS)
    assert "commit 0a1b2c3, load 0.5" in lines[-1]


def test_every_bar_is_between_runners():
    known = {runner.key for runner in RUNNERS}
    assert {bar.ours for bar in BARS} | {bar.peer for bar in BARS} <= known


def test_a_step_has_the_operations_of_its_text():
    # In still air. One more operation in the model's text shows here, because the benchmark's share
    # of a core's peak is computed from this count.
    assert step_flops() == 546


def test_scenario_digest_depends_on_numbers_not_on_tolerance():
    flight = scenario.FLIGHTS["rotorpy"]
    assert scenario.digest(flight) == scenario.digest(scenario.Flight(1.0, wind=flight.wind))
    assert scenario.digest(flight) != scenario.digest(scenario.Flight(2e-9))


@pytest.mark.parametrize("name", scenario.FLIGHTS)
def test_no_scenario_comes_near_the_floor(name):
    assert min(state[2] for state in fly(scenario.FLIGHTS[name])) > 900.0


def test_the_model_for_mujoco_has_our_rotors():
    text = xml(scenario.FLIGHTS["mujoco"].vehicle, "RK4", lag=False)
    assert text.count("<general") == 4
    assert 'mass="1.0"' in text
