"""Requests of a client in their order, and the options that a command passes to its process."""

import threading

import msgspec
import pytest

from quadctl.services.bridges import base
from quadctl.services.bridges.base import Complaints, RequestQueue
from quadctl.services.bridges.options import (
    AutopilotOptions,
    FoxgloveOptions,
    MavlinkOptions,
    Ros2Options,
)
from quadctl.services.runtime.errors import QuadctlError, UsageError
from tests.support.running import DEADLINE, eventually


class Client:
    """Client with a queue whose first order waits for `gate`."""

    def __init__(self) -> None:
        self.done: list[object] = []
        self.faults: list[Exception] = []
        self.gate, self.begun = threading.Event(), threading.Event()
        self.queue = RequestQueue(self.faults.append)
        self.queue.order(self._wait, "first")
        assert self.begun.wait(DEADLINE)

    def _wait(self) -> None:
        self.begun.set()
        assert self.gate.wait(DEADLINE)

    def do(self, name: object):
        return lambda: self.done.append(name)


def test_orders_are_executed_in_their_order_and_a_read_after_those_before_it():
    client = Client()
    client.queue.read(client.do("read"))
    for name in range(5):
        assert client.queue.order(client.do(name)) == "added"
    assert client.done == []
    client.gate.set()
    assert eventually(lambda: len(client.done) == 6)
    assert [each for each in client.done if each != "read"] == [*range(5)]


def test_reads_that_wait_hold_no_order_up():
    queue, gate = RequestQueue(lambda _: None), threading.Event()
    queue.read(lambda: gate.wait(DEADLINE) and None)
    done: list[int] = []
    queue.order(lambda: done.append(1))
    assert eventually(lambda: done == [1])
    gate.set()


def test_of_goals_that_follow_each_other_only_the_newest_is_flown_to():
    client = Client()
    for name in range(1000):
        client.queue.order(client.do(name), newest="goal")
    client.queue.order(client.do("hold"))
    client.queue.order(client.do("next"), newest="goal")
    client.gate.set()
    assert eventually(lambda: len(client.done) == 3)
    assert client.done == [999, "hold", "next"]


def test_a_request_that_is_pending_is_not_added_again():
    client = Client()
    assert client.queue.order(client.do(1), "first") == "waits"
    assert client.queue.order(client.do(1), "a") == "added"
    assert client.queue.order(client.do(2), "a") == "waits"
    assert client.queue.order(client.do(3), "b") == "added"
    assert client.queue.order(client.do(4), "a", once=True) == "waits"
    # E.g. a stop after a goal is no repetition of a stop before it.
    assert client.queue.order(client.do(5), "a") == "added"
    client.gate.set()
    assert eventually(lambda: client.done == [1, 3, 5])


def test_too_many_requests_are_refused():
    client = Client()
    taken = [client.queue.order(client.do(n)) for n in range(base.MOST_WAITING + 1)]
    assert taken == ["added"] * base.MOST_WAITING + ["full"]
    client.queue.end()
    client.gate.set()


def test_a_fault_of_a_request_is_reported_and_ends_no_other():
    client = Client()

    def fail() -> None:
        raise ZeroDivisionError

    client.queue.order(fail)
    client.queue.order(client.do("after"))
    client.gate.set()
    assert eventually(lambda: client.done == ["after"])
    assert [type(each) for each in client.faults] == [ZeroDivisionError]


def test_the_threads_end_with_the_client():
    before = threading.active_count()
    queues = [RequestQueue(lambda _: None) for _ in range(20)]
    for each in queues:
        each.order(lambda: None)
        each.end()
    assert eventually(lambda: threading.active_count() <= before)


def test_a_fault_that_repeats_is_logged_once_until_it_is_over():
    logged: list[str] = []
    complaints = Complaints(lambda _, text: logged.append(text))
    for text in ("a", "a", "b", "", "b", ""):
        complaints.show(text)
    assert logged == ["a", "b", "b"]


@pytest.mark.parametrize(
    "options",
    [
        FoxgloveOptions(port=0), FoxgloveOptions(host="here"), FoxgloveOptions(host="0.0.0.0"),
        FoxgloveOptions(key="key.pem"), FoxgloveOptions(cert="nowhere.pem"), Ros2Options(domain=233),
        Ros2Options(router="nonsense"), MavlinkOptions("udpin:127.0.0.1:14550"),
        MavlinkOptions("udpout:192.0.2.1:14550"), MavlinkOptions(origin=(91.0, 0.0, 0.0)),
        MavlinkOptions(signing_key="nowhere"), AutopilotOptions("tcp:127.0.0.1:1"),
        AutopilotOptions(),
    ],
    ids=repr,
)  # fmt: skip
def test_a_wrong_option_is_refused_with_what_to_do(options):
    with pytest.raises(QuadctlError) as refused:
        options.check()
    assert refused.value.message


@pytest.mark.parametrize(
    "options",
    [
        FoxgloveOptions(8999, origins=("https://a.example",)), Ros2Options(domain=3),
        MavlinkOptions(origin=(47.0, 8.0, 1.5e-7)), AutopilotOptions(fenced=False),
    ],
    ids=repr,
)  # fmt: skip
def test_options_reach_the_process_as_they_were_given(options):
    assert msgspec.json.decode(msgspec.json.encode(options), type=type(options)) == options


def test_a_ros_domain_of_the_environment_counts_without_an_option(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    assert (Ros2Options().number, Ros2Options(domain=3).number) == (7, 3)
    monkeypatch.setenv("ROS_DOMAIN_ID", "seven")
    with pytest.raises(UsageError, match="ROS_DOMAIN_ID=seven"):
        _ = Ros2Options().number
