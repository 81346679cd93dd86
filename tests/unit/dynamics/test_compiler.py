"""Compilation in the background while the vehicle flies, and the behaviour without numba."""

import pytest

from quadctl.services.dynamics import compiler
from quadctl.services.dynamics.compiler import BackgroundCompiler
from tests.support.compiled import compiled_vehicle
from tests.support.lab import CACHE
from tests.support.running import eventually


def test_compilation_runs_in_the_background(monkeypatch: pytest.MonkeyPatch):
    compiled_vehicle()
    monkeypatch.setenv("XDG_CACHE_HOME", str(CACHE))
    background = BackgroundCompiler()
    assert background.model is None
    for _ in range(3):
        background.start()
    eventually(lambda: background.model is not None)


def test_without_numba_nothing_is_compiled(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    without = BackgroundCompiler()
    without._fetch()
    assert without.model is None


def test_a_failed_compilation_is_logged(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    monkeypatch.setattr(compiler, "_MAKING", ("false",))
    monkeypatch.setattr(compiler, "stored", lambda: None)
    without = BackgroundCompiler()
    without._fetch()
    assert without.model is None
    assert "could not be compiled" in caplog.text
