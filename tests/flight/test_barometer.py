"""The barometer as a real part, and what can go wrong with it, on a running system."""

import time
from collections.abc import Iterator

import numpy as np
import pytest

from tests.support.bare import Bare, Watch
from tests.support.doctored import ask
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.running import eventually


class Device:
    """The folder of a sensor."""

    def __init__(self, lab: Lab) -> None:
        self.folder = lab.folder / "iio:device0"
        self.folder.mkdir()
        self.settings = ("--set", "pressure.source=iio", "--set", f"pressure.iio={self.folder}")

    def holds(self, text: str, name: str = "in_pressure_input") -> None:
        """Put a file in place as a whole, as the kernel gives it."""
        fresh = self.folder / "fresh"
        fresh.write_text(text)
        fresh.replace(self.folder / name)


@pytest.fixture(scope="module")
def real() -> Iterator[tuple[Lab, Device]]:
    with private_lab() as made:
        device = Device(made)
        device.holds("101.325000000\n")
        made.start(*device.settings)
        yield made, device


def log(lab: Lab) -> str:
    return (lab.home / "logs" / "pressure.log").read_text(encoding="utf-8")


def test_it_shows_the_sensors_pressure_and_zeroes_it(real: tuple[Lab, Device]):
    lab, device = real
    with lab.bare() as bare:
        readings, poses = bare.watch("uav/sensors/pressure"), bare.watch("uav/pose")
        device.holds("101.325000000\n")
        readings.until(lambda r: r["pressure"] == 1013.25)
        # Whatever the vehicle's height is, and by its time.
        shown = readings.next(11)
        assert {r["pressure"] for r in shown} == {1013.25}
        poses.until(lambda p: p["stamp"] == shown[-1]["stamp"])
        done = lab.quadctl("calibrate", "--json").json
        assert (done["baseline"], done["spread"]) == (1013.25, 0)
        assert done["samples"] in range(9, 12)
        device.holds("101.225000000\n")
        fallen = readings.until(lambda r: r["pressure"] < -0.5)
        assert fallen["pressure"] == pytest.approx(-1.0)
        assert bare.call("calibrate_pressure", zero=False).ok
        fault = {"pressure.fault.kind": "stuck"}
        assert bare.call("pressure/set_params", values=fault).value["success"]
        refused = lab.quadctl("param", "set", "pressure.source", "sim", "--json")
        assert (refused.code, "fixed at launch" in refused.error["message"]) == (6, True)
        well = {"pressure.fault.kind": "none"}
        assert bare.call("pressure/set_params", values=well).value["success"]


def test_garbled_file_ends_the_node_and_a_mended_file_revives_it(real: tuple[Lab, Device]):
    lab, device = real
    device.holds("100.000000000\n")
    with lab.bare() as bare:
        readings = bare.watch("uav/sensors/pressure")
        readings.until(lambda r: r["pressure"] == 1000)
        seen = len(readings.messages)
        old = lab.nodes()["pressure"]["pid"]
        device.holds("garbage\n")
        said = f"error: {device.folder}/in_pressure_input holds 'garbage\\n': not one whole number"
        eventually(lambda: said in log(lab))
        device.holds("90.000000000\n")
        lab.revived("pressure", old)
        readings.until(lambda r: r["pressure"] == 900)
        # Never anything but what the sensor said.
        assert {r["pressure"] for r in readings.messages[seen:]} <= {1000, 900}
    assert "restarted: the baseline is 0 again" in log(lab)


def test_bad_or_missing_file_publishes_nothing_until_a_restart(
    real: tuple[Lab, Device],
):
    lab, device = real
    spoilt = {
        "101.3": "holds '101.3': not one",
        "101325\n": "says 101325 kPa: the air has 25 to 125",
    }
    with lab.bare() as bare:
        readings = bare.watch("uav/sensors/pressure")
        device.holds("90.000000000\n")
        readings.until(lambda r: r["pressure"] == 900)
        seen = len(readings.messages)
        for text, said in spoilt.items():
            device.holds(text)
            eventually(lambda: said in log(lab))  # noqa: B023 - called at once
            device.holds("95.000000000\n")
            assert lab.quadctl("node", "restart", "pressure").code == 0
            assert readings.next()[0]["pressure"] == 950
        (device.folder / "in_pressure_input").unlink()
        eventually(lambda: "neither in_pressure_input nor in_pressure_raw" in log(lab))
        # Another driver: a count to be scaled. It comes last, so that what is there is whole.
        device.holds("0.001000000\n", "in_pressure_scale")
        device.holds("80000\n", "in_pressure_raw")
        assert lab.quadctl("node", "restart", "pressure").code == 0
        assert readings.next()[0]["pressure"] == pytest.approx(800)
        values = {round(r["pressure"], 6) for r in readings.messages[seen:]}
        assert values <= {900, 950, 800}


def test_a_launch_without_the_sensor_fails_and_says_why(lab: Lab):
    device = Device(lab)
    done = lab.quadctl("up", "-d", *device.settings)
    assert done.code == 1
    assert "pressure does not stay up" in done.err
    assert "neither in_pressure_input nor in_pressure_raw" in done.err
    assert "pressure.iio" in done.err


def test_it_needs_no_simulation(lab: Lab):
    device = Device(lab)
    device.holds("101.325000000\n")
    lab.start(*device.settings, "--without", "dynamics", "--without", "safety")
    with lab.bare() as bare:
        first, second = bare.watch("uav/sensors/pressure").next(2)
        assert first["pressure"] == second["pressure"] == 1013.25
        assert 0 < first["stamp"] < second["stamp"]
    assert lab.quadctl("calibrate").code == 0


STEP, NOISE, FURTHEST = 0.16, 0.2, 160.0
"""Of a BMP280, Pa: its resolution, its noise, and how far bias and drift together may be."""


@pytest.fixture(scope="module")
def part() -> Iterator[Lab]:
    """A system with a BMP280, the vehicle in the air at 1 m."""
    with private_lab() as made:
        made.start(
            "--set", "dynamics.start.z=1", "--set", "pressure.profile=bmp280",
            "--set", "pressure.rate=25", "--set", "dynamics.seed=3", *PATIENT,
        )  # fmt: skip
        yield made


@pytest.fixture
def session(part: Lab) -> Iterator[Bare]:
    with part.bare() as bare:
        yield bare
        put_in(bare, kind="none")
        assert bare.call("calibrate_pressure", zero=False).ok


@pytest.fixture
def readings(session: Bare) -> Watch:
    return session.watch("uav/sensors/pressure")


def put_in(bare: Bare, **fault: object) -> None:
    values = {f"pressure.fault.{name}": value for name, value in fault.items()}
    assert bare.call("pressure/set_params", values=values).value["success"]


def test_it_reads_in_its_steps_with_its_noise_and_bias(readings: Watch):
    pascals = 100 * np.array([r["pressure"] for r in readings.next(60)])
    assert pascals / STEP == pytest.approx(np.round(pascals / STEP), abs=1e-3)
    assert NOISE / 2 < pascals.std() < 2 * NOISE
    assert 1 < abs(pascals.mean() - 101312.99) < FURTHEST


def test_its_calibration_says_how_many_and_how_far_apart(part: Lab, readings: Watch):
    readings.next(26)
    done = part.quadctl("calibrate", "--json").json
    assert done["samples"] in range(10, 28)
    assert STEP / 100 <= done["spread"] < 10 * NOISE / 100
    zeroed = readings.until(lambda r: r["baseline"])
    assert zeroed["spread"] == done["spread"]
    assert abs(zeroed["pressure"]) < 6 * NOISE / 100


def test_a_rate_that_it_does_not_have_is_refused(part: Lab, session: Bare):
    done = part.quadctl("param", "set", "pressure.rate", 50, "--json")
    assert done.code == 6
    assert "a bmp280 gives at most 26.3 readings a second" in done.error["message"]
    assert part.quadctl("param", "set", "pressure.profile=ms5611", "pressure.rate=50").code == 0
    back = {"pressure.profile": "bmp280", "pressure.rate": 25.0}
    assert session.call("pressure/set_params", values=back).value["success"]


def test_stuck_it_repeats_itself_until_it_is_mended(session: Bare, readings: Watch):
    put_in(session, kind="stuck")
    readings.next(2)
    stuck = {r["pressure"] for r in readings.next(15)}
    assert len(stuck) == 1
    put_in(session, kind="none")
    readings.until(lambda r: r["pressure"] not in stuck)


def test_off_it_says_nothing_and_cannot_be_calibrated(part: Lab, session: Bare, readings: Watch):
    readings.next()
    put_in(session, kind="off")
    eventually(lambda: session.call("calibrate_pressure", zero=True).code == "not_ready")
    last = readings.messages[-1]
    assert part.quadctl("calibrate").code == 5
    silent = part.quadctl("topic", "echo", "sensors/pressure", "-n", 1, "--timeout", 0.3)
    assert silent.code == 4
    assert readings.messages[-1] == last
    put_in(session, kind="none")
    assert readings.next()[0]["stamp"] > last["stamp"] + 1
    assert session.call("calibrate_pressure", zero=True).ok


def test_glitches_are_spikes_of_the_size_asked_for(session: Bare, readings: Watch):
    level = readings.next()[0]["pressure"]
    put_in(session, kind="glitch", magnitude=5.0, interval=0.1)
    for sign in (1, -1):
        spike = readings.until(lambda r: abs(r["pressure"] - level - sign * 5) < 0.02)  # noqa: B023 - called at once
        assert spike["baseline"] == 0


def test_delayed_it_shows_what_was(part: Lab, session: Bare, readings: Watch):
    # The lab's noise is never the same twice, which tells one reading from another.
    ideal = {"pressure.profile": "lab"}
    assert session.call("pressure/set_params", values=ideal).value["success"]
    readings.next(40)
    mark = len(readings.messages)
    put_in(session, kind="delay", delay=1.0)
    readings.until(lambda _: len(readings.messages) >= mark + 15)
    first: dict[float, float] = {}
    for reading in readings.messages[: mark + 12]:
        first.setdefault(reading["pressure"], reading["stamp"])
    for reading in readings.messages[mark + 2 : mark + 12]:
        assert 0.999 < reading["stamp"] - first[reading["pressure"]] < 2
    back = {"pressure.profile": "bmp280"}
    assert session.call("pressure/set_params", values=back).value["success"]
    put_in(session, kind="none")
    told = ("fault: delay", "fault: none")
    eventually(lambda: all(line in part.quadctl("node", "logs", "pressure").out for line in told))


def test_doctor_sees_that_it_is_stuck_or_off_in_flight(part: Lab, session: Bare, readings: Watch):
    """And the flight goes on as it was: safety does not go by the barometer."""
    states = session.watch("uav/safety/state")
    assert session.call("calibrate_pressure", zero=True).ok
    for kind, x, name, verdict, evidence in (
        ("stuck", 3.0, "barometer", "WARN", "stuck: "),
        ("off", -3.0, "topic uav/sensors/pressure", "FAIL", "nothing came in"),
    ):
        put_in(session, kind=kind)
        session.fly(x, 0.0, 1.0)
        began = time.monotonic()
        found = ask(part)
        took = time.monotonic() - began
        assert evidence in found.said(name, verdict)
        assert found.checks[name]["fix"]
        assert found.said("faults", "WARN").startswith(f"put in: barometer-{kind}")
        assert took < 10, "its whole timeout: it has waited for somebody"
    assert {state["reason"] for state in states.messages} == {""}


def test_calibrated_in_flight_its_spread_says_so(part: Lab, session: Bare, readings: Watch):
    readings.next(30)
    at_rest = part.quadctl("calibrate", "--json").json["spread"]
    poses = session.watch("uav/pose")
    assert session.call("safety/set_params", values={"safety.virtual_cage.z": 50.0}).value[
        "success"
    ]
    # So far that it still climbs when a slow machine has run the command.
    assert session.call("goto", x=0.0, y=0.0, z=45.0).value["accepted"]
    poses.until(lambda p: p["position"]["z"] > 5.0)
    climbing = part.quadctl("calibrate", "--json")
    assert climbing.code == 0
    # 12 Pa a metre: what the second's readings differ by is the climb, no longer the noise.
    assert climbing.json["spread"] > max(5 * at_rest, 0.12)
    shown = readings.until(lambda r: r["baseline"] == climbing.json["baseline"])
    assert shown["spread"] == climbing.json["spread"]
    session.fly(0.0, 0.0, 1.0)
    assert session.call("safety/set_params", values={"safety.virtual_cage.z": 5.0}).value["success"]


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (["pressure.profile=bmp280", "pressure.rate=27"], "a bmp280 gives at most 26.3 readings"),
        (["pressure.source=iio", "dynamics.speed=0"], "needs dynamics.speed 1, not 0"),
    ],
)
def test_what_cannot_be_stops_the_launch(lab: Lab, settings: list[str], said: str):
    done = lab.quadctl(
        "up", "-d", *(word for text in settings for word in ("--set", text)), "--json"
    )
    assert done.code == 6
    assert said in done.error["message"]
    assert lab.is_gone()
