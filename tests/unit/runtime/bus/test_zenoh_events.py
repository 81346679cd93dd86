"""Whether somebody is at the other end, of an end that is none."""

import gc
import weakref
from types import SimpleNamespace
from typing import Any, cast

import zenoh

from quadctl.services.runtime.bus.zenoh_events import MatchingListener


class End:
    """It keeps for ever what it is to tell of changes, as Zenoh does until it is undeclared."""

    def __init__(self) -> None:
        self.matching_status = SimpleNamespace(matching=False)
        self.told: list[Any] = []

    def declare_matching_listener(self, callback: Any) -> object:
        self.told.append(callback)
        return object()

    def change(self, *, there: bool) -> None:
        self.matching_status = SimpleNamespace(matching=there)
        for callback in self.told:
            callback(self.matching_status)


def matching(end: End) -> MatchingListener:
    return MatchingListener(cast("zenoh.Publisher", end))


def test_it_is_told_of_changes_once_somebody_looks():
    end = End()
    other = matching(end)
    end.change(there=True)
    assert (other.is_there, end.told) == (True, [])
    assert other.changes == 0
    end.change(there=False)
    assert (other.is_there, other.changes) == (False, 1)
    assert not other.wait(0.0)
    end.change(there=True)
    assert (other.wait(0.0), other.changes) == (True, 2)


def test_it_is_let_go_while_its_end_goes_on():
    end = End()
    other = matching(end)
    assert other.changes == 0
    gone = weakref.ref(other)
    del other
    gc.collect()
    assert gone() is None
    end.change(there=True)
