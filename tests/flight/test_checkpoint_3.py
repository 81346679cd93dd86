"""Checkpoint 3: the barometer measures the air pressure, and calibrating zeroes it in place."""

import re

import pytest

from tests.support.bare import Bare
from tests.support.lab import Lab
from tests.support.running import eventually

NOISE = 1e-5
PER_METRE = 0.12  # hPa, near the ground


def zeroed(bare: Bare) -> bool:
    return bare.watch("uav/sensors/pressure").next(2)[-1]["baseline"] != 0


def test_the_topic_has_the_air_pressure_at_the_vehicles_height(shared_lab: Lab, hover: Bare):
    echoed = shared_lab.quadctl("topic", "echo", "sensors/pressure", "-n", 3, "--json")
    assert echoed.code == 0
    assert len(echoed.rows) == 3
    for reading in echoed.rows:
        assert reading["pressure"] == pytest.approx(1013.13, abs=0.01)
        assert reading["baseline"] == 0
    text = shared_lab.quadctl("topic", "echo", "sensors/pressure", "-n", 1, "--field", "pressure")
    assert float(text.out) == pytest.approx(1013.13, abs=0.01)


def test_calibrating_zeroes_the_topic_and_unset_restores_it(shared_lab: Lab, hover: Bare):
    heights, readings = hover.watch("uav/pose"), hover.watch("uav/sensors/pressure")
    readings.next(11)  # so that the vehicle was at rest for the whole averaged second
    done = shared_lab.quadctl("calibrate")
    assert done.code == 0
    assert re.match(r"baseline: 1013\.\d{4} hPa\n", done.out)
    baseline = float(done.out.split()[1])
    rest = heights.next()[0]["position"]["z"]
    for reading in readings.next(5):
        assert reading["baseline"] == pytest.approx(baseline, abs=1e-4)
        assert reading["samples"] in range(9, 12)
        drift = max(abs(p["position"]["z"] - rest) for p in heights.messages[-300:])
        assert abs(reading["pressure"]) <= 3 * NOISE + PER_METRE * drift

    def climbed(stamp: float) -> float:
        """Return the height (m) at the time of a reading, above the one where it was zeroed."""
        return heights.until(lambda pose: pose["stamp"] >= stamp)["position"]["z"] - rest

    hover.fly(0.0, 0.0, 2.0)
    arrived = heights.next()[0]["stamp"]
    above = readings.until(lambda reading: reading["stamp"] >= arrived)
    fallen = -PER_METRE * climbed(above["stamp"])
    assert above["pressure"] == pytest.approx(fallen, abs=0.005)

    unset = shared_lab.quadctl("calibrate", "--unset", "--json")
    assert unset.json["baseline"] == 0
    after = readings.until(lambda r: r["baseline"] == 0)
    fallen = -PER_METRE * climbed(after["stamp"])
    assert after["pressure"] == pytest.approx(baseline + fallen, abs=0.005)
    assert (after["samples"], after["spread"]) == (0, 0)


@pytest.mark.thorough
def test_calibrating_in_a_climb_warns_and_settling_waits_for_rest(lab: Lab):
    # At a fifth of real time the climb outlasts the command on any machine.
    lab.start("--set", "dynamics.speed=0.2", "--set", "safety.takeoff=4")
    eventually(lambda: lab.quadctl("state", "--json").json["pose"]["position"]["z"] > 1.5)
    climbing = lab.quadctl("calibrate")
    assert climbing.code == 0
    assert "warning: the samples spread too far for a zero" in climbing.err
    settled = lab.quadctl("goto", 0, 0, 3, "--replace", "--settle", "--arrive", 60)
    assert settled.code == 0, settled.err
    assert re.search(r"^rests within 0\.0\d m after", settled.out, re.MULTILINE)


def test_a_service_call_calibrates_as_in_the_lab(shared_lab: Lab, hover: Bare):
    called = shared_lab.quadctl("service", "call", "/calibrate_pressure", "True", "--json")
    assert called.code == 0
    assert called.json["baseline"] == pytest.approx(1013, abs=0.5)
    assert zeroed(hover)
    assert hover.call("calibrate_pressure", zero=False).value == {"baseline": 0}


def test_the_first_message_is_a_reading_and_early_calls_not_ready(lab: Lab):
    lab.spawn(*lab.command("up"))
    with lab.first_bare() as bare:
        readings = bare.watch("uav/sensors/pressure")
        early = eventually(lambda: bare.answers("uav/@srv/calibrate_pressure", b"\x81\xa4zero\xc3"))
        answer = early[0]
        first = readings.until(lambda _: True)
        # Before its first sample it answers `not_ready`, afterwards it averages the samples it has.
        if answer.ok:
            assert answer.value["baseline"] == pytest.approx(1013.25, abs=0.2)
        else:
            assert answer.code == "not_ready"
            assert first["baseline"] == 0
        assert first["pressure"] + first["baseline"] == pytest.approx(1013.25, abs=0.2)
    eventually(lab.is_ready)


def test_without_dynamics_nothing_is_calibrated_or_published(lab: Lab):
    lab.start("--without", "dynamics", "--without", "safety")
    refused = lab.quadctl("calibrate", "--json")
    assert (refused.code, refused.error["code"]) == (5, "not_ready")
    silent = lab.quadctl("topic", "echo", "sensors/pressure", "-n", 1, "--timeout", 0.5)
    assert (silent.code, silent.out) == (4, "")
