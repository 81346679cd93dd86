"""Matching status of a publisher, with a stand-in for it."""

import gc
import weakref
from types import SimpleNamespace
from typing import Any, cast

import zenoh

from quadctl.services.runtime.bus.zenoh_events import MatchingListener


class FakePublisher:
    """Publisher that keeps its callbacks forever, as Zenoh does until they are undeclared."""

    def __init__(self) -> None:
        self.matching_status = SimpleNamespace(matching=False)
        self.callbacks: list[Any] = []

    def declare_matching_listener(self, callback: Any) -> object:
        self.callbacks.append(callback)
        return object()

    def change(self, *, there: bool) -> None:
        self.matching_status = SimpleNamespace(matching=there)
        for callback in self.callbacks:
            callback(SimpleNamespace(matching=there))


def matching(publisher: FakePublisher) -> MatchingListener:
    return MatchingListener(cast("zenoh.Publisher", publisher))


def test_the_listener_is_declared_on_the_first_query():
    publisher = FakePublisher()
    listener = matching(publisher)
    publisher.change(there=True)
    assert (listener.is_there, publisher.callbacks) == (True, [])
    assert listener.changes == 0
    publisher.change(there=False)
    assert (listener.is_there, listener.changes) == (False, 1)
    assert not listener.wait(0.0)
    publisher.change(there=True)
    assert (listener.wait(0.0), listener.changes) == (True, 2)
    del publisher.matching_status
    assert listener.was_there
    publisher.change(there=False)
    assert not listener.was_there


def test_the_status_is_read_once_and_then_the_listeners_report_counts():
    publisher = FakePublisher()
    publisher.change(there=True)
    listener = matching(publisher)
    assert (listener.wait(0.0), publisher.callbacks) == (True, [])
    assert listener.wait(0.0)
    del publisher.matching_status
    assert listener.wait(0.0)
    publisher.change(there=False)
    assert not listener.wait(0.0)


def test_the_listener_is_collected_while_its_publisher_lives():
    publisher = FakePublisher()
    listener = matching(publisher)
    assert listener.changes == 0
    gone = weakref.ref(listener)
    del listener
    gc.collect()
    assert gone() is None
    publisher.change(there=True)
