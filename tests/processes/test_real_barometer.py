"""A real sensor through Linux's IIO files, in a made-up tree: its values, or none and an error."""

from collections.abc import Iterator

import pytest

from tests.processes.lab import Lab, private_lab
from tests.processes.running import eventually


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


def test_garbled_it_ends_saying_so_and_is_back_when_the_file_is_mended(real: tuple[Lab, Device]):
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


def test_torn_gone_or_beyond_the_air_it_says_nothing_and_a_restart_asked_for_brings_it_back(
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
