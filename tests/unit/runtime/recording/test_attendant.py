"""Reports of the recorder to a command that does not read them."""

import os
from typing import cast

import pytest

from quadctl.services.recorder.__main__ import Attendant


@pytest.mark.parametrize(("state", "sent"), [("recording", 0), ("done", 1), ("failed", 1)])
def test_only_the_last_report_waits_for_room(
    monkeypatch: pytest.MonkeyPatch, state: str, sent: int
):
    lines, full = list[bytes](), iter([True, True])

    def write(_descriptor: int, line: bytes) -> int:
        if next(full, False):
            raise BlockingIOError
        lines.append(line)
        return len(line)

    with monkeypatch.context() as patched:
        patched.setattr(os, "write", write)
        Attendant.send(cast("Attendant", None), {"state": state})
    assert len(lines) == sent
