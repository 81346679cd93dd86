"""A real sensor's files: converted to hPa, or an error with the file, its text and a hint."""

import os
from collections.abc import Mapping
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from quadctl.services.pressure import iio
from quadctl.services.pressure.iio import has_pressure, hectopascals
from quadctl.services.runtime.errors import QuadctlError


def test_devices_are_sorted_by_number(tmp_path: Path):
    for name in (
        "iio:device10",
        "iio:device2",
        "iio:device0",
        "trigger0",
        "iio:deviceX",
        "iio_sysfs",
    ):
        (tmp_path / name).mkdir()
    (tmp_path / "iio:device3").symlink_to(tmp_path / "iio:device0")  # as sysfs has them
    names = [path.name for path in iio.devices(tmp_path)]
    assert names == ["iio:device0", "iio:device2", "iio:device3", "iio:device10"]


def test_without_a_sysfs_tree_there_are_no_devices(tmp_path: Path):
    assert iio.devices(tmp_path / "none") == []


def test_a_file_is_returned_unchanged(tmp_path: Path):
    (tmp_path / "in_pressure_input").write_bytes(b"101.3\n")
    assert iio.read(tmp_path, "in_pressure_input") == b"101.3\n"
    assert iio.read(tmp_path, "in_pressure_raw") is None
    assert iio.read(tmp_path / "gone", "in_pressure_raw") is None


def test_a_long_file_is_read_only_in_part(tmp_path: Path):
    (tmp_path / "long").write_bytes(b"1" * 100_000)
    assert iio.read(tmp_path, "long") == b"1" * 200


def test_a_pipe_is_read_without_waiting(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    assert iio.read(tmp_path, "pipe") == b""


def test_an_unreadable_file_is_named(tmp_path: Path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(QuadctlError, match=r"folder cannot be read: Is a directory") as caught:
        iio.read(tmp_path, "folder")
    assert str(tmp_path) in caught.value.message


INPUT, RAW = "in_pressure_input", "in_pressure_raw"
SCALE, OFFSET = "in_pressure_scale", "in_pressure_offset"


def read(files: Mapping[str, bytes]) -> float:
    return hectopascals("/dev7", files.get)


def refused(files: Mapping[str, bytes]) -> str:
    with pytest.raises(QuadctlError) as caught:
        read(files)
    assert caught.value.exit_code == 1
    assert caught.value.hint
    return caught.value.message


@given(st.integers(250_000_000, 1_250_000_000))
def test_kilopascals_become_hectopascals(micro: int):
    text = f"{micro // 10**7}.{micro % 10**7:07}\n".encode()
    assert read({INPUT: text}) == pytest.approx(micro / 10**6, abs=1e-9)


def test_the_formats_of_known_drivers_are_read():
    # bmp280: a fraction; ms5611: a whole number and a fraction; a whole number alone.
    assert read({INPUT: b"101.325000000\n"}) == pytest.approx(1013.25)
    assert read({INPUT: b"100\n"}) == 1000
    # st_pressure: a count, scaled.
    assert read({RAW: b"4150272\n", SCALE: b"0.000024414\n"}) == pytest.approx(1013.247, abs=1e-3)
    # hid-sensor-press and others: with an offset, which is added to the count.
    assert read({RAW: b"900\n", OFFSET: b"-100\n", SCALE: b"0.125\n"}) == 1000
    # If a driver offers both, its own conversion is used.
    assert read({INPUT: b"100\n", RAW: b"1\n", SCALE: b"1\n"}) == 1000


@pytest.mark.parametrize(
    "text",
    [
        b"", b"\n", b"101.3", b"101.", b"101.\n", b"nan\n", b"inf\n", b"-inf\n", b"1e2\n", b"0x65\n",
        b"101 .3\n", b"101,3\n", b"101.3 kPa\n", b"101.3\n101.3\n", b"1_01\n", b"garbage\n",
        b"\xff\xfe\n", b" 101.3\n", "१०१\n".encode(), b"101.3\0", b"--101\n",
    ],
)  # fmt: skip
def test_malformed_or_torn_number_is_refused_with_the_text(text: bytes):
    message = refused({INPUT: text})
    assert "/dev7/in_pressure_input holds " in message
    assert ("nothing" if not text else repr(text.decode(errors="replace"))) in message
    for name in (RAW, SCALE, OFFSET):
        files = {RAW: b"900\n", OFFSET: b"-100\n", SCALE: b"0.125\n"} | {name: text}
        assert f"/dev7/{name} holds " in refused(files)


@pytest.mark.parametrize(
    "text",
    [b"0\n", b"-101.3\n", b"24.99\n", b"125.01\n", b"1013.25\n", b"101325\n", b"9" * 199 + b"\n"],
)
def test_an_impossible_air_pressure_is_refused(text: bytes):
    """Cover drivers that report Pa or hPa, and broken sensors."""
    assert "in_pressure_input reads " in refused({INPUT: text})
    assert "in_pressure_raw with in_pressure_scale reads " in refused({RAW: text, SCALE: b"1\n"})


def test_a_device_without_pressure_is_refused():
    assert (
        refused({})
        == "/dev7 has neither in_pressure_input nor in_pressure_raw: no barometer, or unplugged"
    )
    assert "no in_pressure_scale" in refused({RAW: b"900\n"})


def test_a_device_with_pressure_is_a_barometer():
    assert has_pressure({INPUT: b""}.get)
    assert has_pressure({RAW: b""}.get)
    assert not has_pressure({"in_temp_input": b"21000\n"}.get)


@given(st.dictionaries(st.sampled_from([INPUT, RAW, SCALE, OFFSET]), st.binary(max_size=20)))
def test_any_file_content_gives_air_pressure_or_an_error(files: dict[str, bytes]):
    try:
        found = read(files)
    except QuadctlError:
        return
    assert 250 <= found <= 1250
