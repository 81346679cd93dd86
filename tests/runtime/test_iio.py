"""Linux's IIO devices in a made-up tree."""

import os
from pathlib import Path

import pytest

from quadctl.services.pressure import iio
from quadctl.services.runtime.errors import QuadctlError


def test_devices_come_in_the_order_of_their_numbers(tmp_path: Path):
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


def test_where_there_is_no_such_tree_there_are_none(tmp_path: Path):
    assert iio.devices(tmp_path / "none") == []


def test_a_file_is_read_as_it_is(tmp_path: Path):
    (tmp_path / "in_pressure_input").write_bytes(b"101.3\n")
    assert iio.read(tmp_path, "in_pressure_input") == b"101.3\n"
    assert iio.read(tmp_path, "in_pressure_raw") is None
    assert iio.read(tmp_path / "gone", "in_pressure_raw") is None


def test_one_without_end_is_read_in_part(tmp_path: Path):
    (tmp_path / "long").write_bytes(b"1" * 100_000)
    assert iio.read(tmp_path, "long") == b"1" * 200


def test_a_pipe_in_its_place_is_not_waited_for(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    assert iio.read(tmp_path, "pipe") == b""


def test_one_that_cannot_be_read_is_named(tmp_path: Path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(QuadctlError, match=r"folder cannot be read: Is a directory") as caught:
        iio.read(tmp_path, "folder")
    assert str(tmp_path) in caught.value.message
