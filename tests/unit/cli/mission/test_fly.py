"""Topics of a flight's record: the fewest messages that bring each pose."""

from typing import Any, cast

import pytest

from quadctl.cli.mission.fly import _fewer
from quadctl.schemas.messages import Poses
from quadctl.schemas.topics import POSE, POSES, STATE
from quadctl.services.runtime.bus.client import Client


class _Stream:
    def __init__(self, message: Poses | None) -> None:
        self.message, self.is_closed = message, False

    def next(self, _timeout: float) -> Poses | None:
        return self.message

    def close(self) -> None:
        self.is_closed = True


@pytest.mark.parametrize(("message", "topic"), [(Poses([]), POSES), (None, POSE)])
def test_poses_come_one_by_one_from_a_vehicle_that_publishes_no_batches(
    message: Poses | None, topic: Any
):
    stream = _Stream(message)

    class _Client:
        def subscribe(self, *_: Any) -> _Stream:
            return stream

    assert _fewer(cast("Client", _Client()), (POSE, STATE)) == [topic, STATE]
    assert stream.is_closed
