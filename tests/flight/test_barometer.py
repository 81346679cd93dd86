"""The barometer as a real sensor, and its faults, on a running system."""

from collections.abc import Iterator

import numpy as np
import pytest

from tests.support.bare import Bare, Watch
from tests.support.doctored import ask
from tests.support.lab import PATIENT, Lab, private_lab, sets
from tests.support.running import eventually


class Device:
    """Folder of an IIO sensor."""

    def __init__(self, lab: Lab) -> None:
        self.folder = lab.folder / "iio:device0"
        self.folder.mkdir()
        self.settings = ("--set", "pressure.source=iio", "--set", f"pressure.iio={self.folder}")

    def write(self, text: str, name: str = "in_pressure_input") -> None:
        """Replace a file atomically: a reader never sees it half written, as with the kernel's files."""
        fresh = self.folder / "fresh"
        fresh.write_text(text)
        fresh.replace(self.folder / name)


@pytest.fixture
def real_sensor(lab: Lab) -> tuple[Lab, Device]:
    device = Device(lab)
    device.write("101.325000000\n")
    lab.start(*device.settings)
    return lab, device


@pytest.mark.thorough
def test_the_node_publishes_the_sensors_pressure_and_zeroes_it(real_sensor: tuple[Lab, Device]):
    lab, device = real_sensor
    with lab.bare() as bare:
        readings, poses = bare.watch("uav/sensors/pressure"), bare.watch("uav/pose")
        device.write("101.325000000\n")
        readings.until(lambda r: r["pressure"] == 1013.25)
        # Independent of the vehicle's height, and stamped with the simulation's time.
        shown = readings.next(11)
        assert {r["pressure"] for r in shown} == {1013.25}
        poses.until(lambda p: p["stamp"] == shown[-1]["stamp"])
        done = lab.quadctl("calibrate", "--json").json
        assert (done["baseline"], done["spread"]) == (1013.25, 0)
        # Ten a second; a busy machine takes fewer.
        assert done["samples"] in range(1, 12)
        device.write("101.225000000\n")
        fallen = readings.until(lambda r: r["pressure"] < -0.5)
        assert fallen["pressure"] == pytest.approx(-1.0)
        assert bare.call("calibrate_pressure", zero=False).ok
        fault = {"pressure.fault.kind": "stuck"}
        assert bare.call("pressure/set_params", values=fault).value["success"]
        refused = lab.quadctl("param", "set", "pressure.source", "sim", "--json")
        assert (refused.code, "fixed at launch" in refused.error["message"]) == (6, True)


def test_a_garbled_file_ends_the_node_and_a_repaired_one_revives_it(
    real_sensor: tuple[Lab, Device],
):
    lab, device = real_sensor
    device.write("100.000000000\n")
    with lab.bare() as bare:
        readings = bare.watch("uav/sensors/pressure")
        readings.until(lambda r: r["pressure"] == 1000)
        seen = len(readings.messages)
        old = lab.nodes()["pressure"]["pid"]
        device.write("garbage\n")
        said = (
            f"error: {device.folder}/in_pressure_input holds 'garbage\\n': not one complete number"
        )
        eventually(lambda: said in lab.log("pressure"))
        device.write("90.000000000\n")
        lab.revived("pressure", old)
        readings.until(lambda r: r["pressure"] == 900)
        # Only values that the sensor had are published.
        assert {r["pressure"] for r in readings.messages[seen:]} <= {1000, 900}
    eventually(lambda: "restarted: the baseline is 0 again" in lab.log("pressure"))


@pytest.mark.thorough
def test_a_bad_or_missing_file_stops_publishing_until_a_restart(
    real_sensor: tuple[Lab, Device],
):
    lab, device = real_sensor
    spoilt = {
        "101.3": "holds '101.3': not one",
        "101325\n": "reads 101325 kPa: air has 25 to 125",
    }
    with lab.bare() as bare:
        readings = bare.watch("uav/sensors/pressure")
        device.write("90.000000000\n")
        readings.until(lambda r: r["pressure"] == 900)
        seen = len(readings.messages)
        for text, said in spoilt.items():
            device.write(text)
            eventually(lambda: said in lab.log("pressure"))  # noqa: B023 - called at once
            device.write("95.000000000\n")
            assert lab.quadctl("node", "restart", "pressure").code == 0
            assert readings.next()[0]["pressure"] == 950
        (device.folder / "in_pressure_input").unlink()
        eventually(lambda: "neither in_pressure_input nor in_pressure_raw" in lab.log("pressure"))
        # Another driver: a raw count and a scale. The count comes last, when the scale is in place.
        device.write("0.001000000\n", "in_pressure_scale")
        device.write("80000\n", "in_pressure_raw")
        assert lab.quadctl("node", "restart", "pressure").code == 0
        assert readings.next()[0]["pressure"] == pytest.approx(800)
        values = {round(r["pressure"], 6) for r in readings.messages[seen:]}
        assert values <= {900, 950, 800}


@pytest.mark.thorough
def test_a_launch_without_the_sensor_fails_with_the_reason(lab: Lab):
    device = Device(lab)
    done = lab.quadctl("up", "-d", *device.settings)
    assert done.code == 1
    assert "pressure does not stay up" in done.err
    assert "neither in_pressure_input nor in_pressure_raw" in done.err
    assert "pressure.iio" in done.err
    assert "in_pressure_raw" in lab.taken_logs()["pressure.log"]


@pytest.mark.thorough
def test_a_real_sensor_needs_no_simulation(lab: Lab):
    device = Device(lab)
    device.write("101.325000000\n")
    lab.start(*device.settings, "--without", "dynamics", "--without", "safety")
    with lab.bare() as bare:
        first, second = bare.watch("uav/sensors/pressure").next(2)
        assert first["pressure"] == second["pressure"] == 1013.25
        assert 0 < first["stamp"] < second["stamp"]
    assert lab.quadctl("calibrate").code == 0


STEP, NOISE, FURTHEST = 0.16, 0.2, 160.0
"""Pa, of a BMP280: its resolution, its noise, and the limit of bias and drift together."""


@pytest.fixture(scope="module")
def bmp280() -> Iterator[Lab]:
    """System with a BMP280, the vehicle in the air at 1 m."""
    with private_lab() as made:
        made.share(
            "--set", "dynamics.start.z=1", "--set", "pressure.profile=bmp280",
            "--set", "pressure.rate=25", "--set", "dynamics.seed=3", *PATIENT,
        )  # fmt: skip
        yield made


@pytest.fixture
def session(bmp280: Lab) -> Iterator[Bare]:
    with bmp280.put_back_session() as bare:
        yield bare


@pytest.fixture
def readings(session: Bare) -> Watch:
    return session.watch("uav/sensors/pressure")


def inject(bare: Bare, **fault: object) -> None:
    values = {f"pressure.fault.{name}": value for name, value in fault.items()}
    assert bare.call("pressure/set_params", values=values).value["success"]


@pytest.mark.thorough
def test_readings_of_a_bmp280_have_its_steps_noise_and_bias(readings: Watch):
    pascals = 100 * np.array([r["pressure"] for r in readings.next(60)])
    assert pascals / STEP == pytest.approx(np.round(pascals / STEP), abs=1e-3)
    # The differences leave the slow drift of the bias out.
    assert NOISE / 2 < np.diff(pascals).std() / 2**0.5 < 2 * NOISE
    assert 1 < abs(pascals.mean() - 101312.99) < FURTHEST


@pytest.mark.thorough
def test_a_calibration_reports_the_number_and_spread_of_samples(bmp280: Lab, readings: Watch):
    readings.next(26)
    done = bmp280.quadctl("calibrate", "--json").json
    # 25 a second, and those of up to 0.1 s that a late loop catches up with; a busy machine takes fewer.
    assert done["samples"] in range(2, 30)
    assert STEP / 100 <= done["spread"] < 10 * NOISE / 100
    zeroed = readings.until(lambda r: r["baseline"])
    assert zeroed["spread"] == done["spread"]
    assert abs(zeroed["pressure"]) < 6 * NOISE / 100


def test_a_rate_above_the_sensors_maximum_is_refused(bmp280: Lab, session: Bare):
    done = bmp280.quadctl("param", "set", "pressure.rate", 50, "--json")
    assert done.code == 6
    assert "a bmp280 gives at most 26.3 readings a second" in done.error["message"]
    assert bmp280.quadctl("param", "set", "pressure.profile=ms5611", "pressure.rate=50").code == 0


def test_a_stuck_barometer_repeats_one_value_until_it_is_repaired(session: Bare, readings: Watch):
    inject(session, kind="stuck")
    readings.next(2)
    stuck = {r["pressure"] for r in readings.next(15)}
    assert len(stuck) == 1
    inject(session, kind="none")
    readings.until(lambda r: r["pressure"] not in stuck)


@pytest.mark.thorough
def test_a_barometer_that_is_off_is_silent_and_not_calibrated(
    bmp280: Lab, session: Bare, readings: Watch
):
    readings.next()
    inject(session, kind="off")
    eventually(lambda: session.call("calibrate_pressure", zero=True).code == "not_ready")
    last = readings.messages[-1]
    assert bmp280.quadctl("calibrate").code == 5
    silent = bmp280.quadctl("topic", "echo", "sensors/pressure", "-n", 1, "--timeout", 0.3)
    assert silent.code == 4
    assert readings.messages[-1] == last
    inject(session, kind="none")
    assert readings.next()[0]["stamp"] > last["stamp"] + 1
    assert session.call("calibrate_pressure", zero=True).ok


def test_glitches_are_spikes_of_the_requested_size(session: Bare, readings: Watch):
    level = readings.next()[0]["pressure"]
    inject(session, kind="glitch", magnitude=5.0, interval=0.1)
    for sign in (1, -1):
        spike = readings.until(lambda r: abs(r["pressure"] - level - sign * 5) < 0.02)  # noqa: B023 - called at once
        assert spike["baseline"] == 0


@pytest.mark.thorough
def test_a_delayed_barometer_publishes_older_readings(bmp280: Lab, session: Bare, readings: Watch):
    # The noise of profile `lab` never repeats a value, so each reading can be identified.
    ideal = {"pressure.profile": "lab"}
    assert session.call("pressure/set_params", values=ideal).value["success"]
    readings.next(40)
    mark = len(readings.messages)
    inject(session, kind="delay", delay=1.0)
    readings.until(lambda _: len(readings.messages) >= mark + 15)
    first: dict[float, float] = {}
    for reading in readings.messages[: mark + 12]:
        first.setdefault(reading["pressure"], reading["stamp"])
    for reading in readings.messages[mark + 2 : mark + 12]:
        assert 0.999 < reading["stamp"] - first[reading["pressure"]] < 2
    inject(session, kind="none")
    told = ("fault: delay", "fault: none")
    eventually(lambda: all(line in bmp280.quadctl("node", "logs", "pressure").out for line in told))


@pytest.mark.thorough
def test_doctor_reports_a_barometer_stuck_or_off_in_flight(
    bmp280: Lab, session: Bare, readings: Watch
):
    """Check also that the flight goes on: safety does not use the barometer."""
    states = session.watch("uav/safety/state")
    assert session.call("calibrate_pressure", zero=True).ok
    for kind, x, name, verdict, evidence in (
        ("stuck", 3.0, "barometer", "WARN", "stuck: "),
        ("off", -3.0, "topic uav/sensors/pressure", "FAIL", "nothing came in"),
    ):
        inject(session, kind=kind)
        session.fly(x, 0.0, 1.0)
        found = ask(bmp280)
        assert evidence in found.said(name, verdict)
        assert found.checks[name]["fix"]
        assert found.said("faults", "WARN").startswith(f"put in: barometer-{kind}")
    assert {state["reason"] for state in states.messages} == {""}


def test_a_calibration_while_climbing_has_a_larger_spread(
    bmp280: Lab, session: Bare, readings: Watch
):
    readings.next(30)
    at_rest = bmp280.quadctl("calibrate", "--json").json["spread"]
    poses = session.watch("uav/pose")
    assert session.call("safety/set_params", values={"safety.virtual_cage.z": 50.0}).value[
        "success"
    ]
    # High enough that it still climbs when a slow machine has run the command.
    assert session.call("goto", x=0.0, y=0.0, z=45.0).value["accepted"]
    poses.until(lambda p: p["position"]["z"] > 5.0)
    climbing = bmp280.quadctl("calibrate", "--json")
    assert climbing.code == 0
    # 12 Pa a metre: the readings of the last second differ by the climb, far above the noise.
    assert climbing.json["spread"] > max(5 * at_rest, 0.12)
    shown = readings.until(lambda r: r["baseline"] == climbing.json["baseline"])
    assert shown["spread"] == climbing.json["spread"]


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (["pressure.profile=bmp280", "pressure.rate=27"], "a bmp280 gives at most 26.3 readings"),
        (
            ["pressure.source=iio", "dynamics.speed=0"],
            "it needs dynamics.speed 1 and dynamics.lockstep false",
        ),
    ],
)
def test_impossible_barometer_settings_stop_the_launch(lab: Lab, settings: list[str], said: str):
    done = lab.quadctl("up", "-d", *sets(*settings), "--json")
    assert done.code == 6
    assert said in done.error["message"]
    assert lab.is_gone()
