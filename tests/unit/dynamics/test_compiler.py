"""Compiled code for who flies already: it comes when it comes, and without numba it does not."""

import pytest

from quadctl.services.dynamics import compiler
from quadctl.services.dynamics.compiler import BackgroundCompiler
from tests.support.compiled import compiled_vehicle
from tests.support.lab import CACHE
from tests.support.running import eventually

pytestmark = pytest.mark.timeout(200)


def test_nobody_waits_for_it(monkeypatch: pytest.MonkeyPatch):
    compiled_vehicle()
    monkeypatch.setenv("XDG_CACHE_HOME", str(CACHE))
    waited = BackgroundCompiler()
    assert waited.single() is None
    for _ in range(3):
        waited.start()
    eventually(lambda: waited.single() is not None)


def test_without_numba_there_is_none(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    without = BackgroundCompiler()
    without._fetch()
    assert without.single() is None


def test_where_it_cannot_be_made_that_is_told(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    monkeypatch.setattr(compiler, "_MAKING", ("false",))
    monkeypatch.setattr(compiler, "stored", lambda: None)
    without = BackgroundCompiler()
    without._fetch()
    assert without.single() is None
    assert "could not be compiled" in caplog.text
