"""`fleet land-all`: the vehicles of a hub stop before one of them lands."""

from threading import Barrier, Event, Thread
from typing import cast

import pytest

from quadctl.cli.fleet.land import _stop
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import TimedOut
from tests.support.running import DEADLINE


class FakeClient:
    """Client of a vehicle that obeys, or is silent."""

    def __init__(self, *, silent: bool = False) -> None:
        self.told, self._silent = Event(), silent

    def call(self, *_: object) -> None:
        self.told.set()
        if self._silent:
            raise TimedOut("hold did not answer")


def stop(client: FakeClient, told: Barrier, left: float = DEADLINE) -> None:
    _stop(cast("Client", client), left, told)


@pytest.mark.parametrize("silent", [False, True])
def test_a_vehicle_lands_after_the_others_of_its_hub_were_told_to_stop(*, silent: bool):
    told, first, last, lands = Barrier(2), FakeClient(), FakeClient(silent=silent), Event()

    def land() -> None:
        stop(first, told)
        assert last.told.is_set()
        lands.set()

    Thread(target=land, daemon=True).start()
    assert first.told.wait(DEADLINE)
    if silent:
        with pytest.raises(TimedOut):
            stop(last, told)
    else:
        stop(last, told)
    assert lands.wait(DEADLINE)


def test_a_vehicle_that_never_connects_holds_up_no_other_beyond_the_timeout():
    stop(FakeClient(), Barrier(2), left=0.01)
