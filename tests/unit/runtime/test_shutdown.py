"""Signals that end a process."""

import signal

import pytest

from quadctl.services.runtime.shutdown import uninterrupted


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_waits_until_a_block_is_done(number: int):
    came: list[int] = []
    before = signal.signal(number, lambda number, _frame: came.append(number))
    try:
        with uninterrupted():
            signal.raise_signal(number)
            assert came == []
        assert came == [number]
    finally:
        signal.signal(number, before)
