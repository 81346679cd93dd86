"""Choice of the real sensor's folder."""

from pathlib import Path

import pytest

from quadctl.services.pressure.__main__ import device
from quadctl.services.runtime.errors import QuadctlError


def test_the_configured_folder_is_used_without_a_search(tmp_path: Path):
    assert device("/no/such/folder", tmp_path) == Path("/no/such/folder")


def test_otherwise_the_first_device_with_pressure_is_used(tmp_path: Path):
    for number, name in (
        (0, "in_temp_input"),
        (1, "in_illuminance_raw"),
        (10, "in_pressure_input"),
    ):
        folder = tmp_path / f"iio:device{number}"
        folder.mkdir()
        (folder / name).write_text("1\n")
    assert device("", tmp_path) == tmp_path / "iio:device10"
    (tmp_path / "iio:device2").mkdir()
    (tmp_path / "iio:device2" / "in_pressure_raw").write_text("1\n")
    assert device("", tmp_path) == tmp_path / "iio:device2"


def test_without_a_device_the_error_names_the_searched_folder(tmp_path: Path):
    with pytest.raises(
        QuadctlError, match=f"no device under {tmp_path} measures pressure"
    ) as caught:
        device("", tmp_path)
    assert "pressure.iio" in caught.value.hint
