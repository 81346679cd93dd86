"""Which folder the real sensor is read from."""

from pathlib import Path

import pytest

from quadctl.services.pressure.__main__ import device
from quadctl.services.runtime.errors import QuadctlError


def test_the_one_named_is_taken_whatever_is_there(tmp_path: Path):
    assert device("/no/such/folder", tmp_path) == Path("/no/such/folder")


def test_else_the_first_that_has_pressure(tmp_path: Path):
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


def test_where_none_has_it_says_where_it_looked_and_what_to_do(tmp_path: Path):
    with pytest.raises(QuadctlError, match=f"no device under {tmp_path} has pressure") as caught:
        device("", tmp_path)
    assert "pressure.iio" in caught.value.hint
