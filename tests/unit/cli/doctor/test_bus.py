"""Checks of doctor on a bus: rates, publishers, servers, schemas, clocks."""

from math import nan
from typing import Any

import msgspec
import pytest
from msgspec import Struct
from msgspec.structs import replace

from quadctl.cli.doctor import bus
from quadctl.cli.doctor.check import Finding
from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.schemas.topics import GOTO, SERVICES, TOPICS
from quadctl.schemas.typeinfo import schema_hash
from quadctl.services.runtime.bus.survey import Answer, Survey, TopicStats
from quadctl.services.runtime.run_files import ProcessRecord, RunState


def digest(type_: type[Struct]) -> str:
    return schema_hash(type_)


TOPIC = [
    EndpointInfo("uav", "@pub", t.node, t.type.__name__, digest(t.type), t.hz, t.key("uav"))
    for t in TOPICS
    if t.node
]
SERVICE = [
    EndpointInfo("uav", "@srv", s.node, s.type_name, digest(s.request), 0.0, s.key("uav"))
    for s in SERVICES
]
NODES = ["dynamics", "hub", "pressure", "safety"]
POSE = next(offer for offer in TOPIC if offer.type == "Pose")
RUN = RunState("lab", 5, ["uav"], [ProcessRecord(name, 9, "ready", 0) for name in NODES])


def arrivals(
    count: int, hz: float, pace: float = 1.0, source: str = "a", age: float = 0.001
) -> TopicStats:
    """Return statistics of `count` messages at a rate, stamped by a clock that runs at `pace`."""
    found = TopicStats()
    for number in range(count):
        stamp = pace * number / hz
        found.take(100 + number / hz, msgspec.msgpack.encode({"stamp": stamp}), source, age)
    return found


def survey(**changes: Any) -> Survey:
    """Return the survey of a healthy bus, with changes."""
    messages = {offer.key: arrivals(int(2 * offer.hz) + 1, offer.hz or 1) for offer in TOPIC}
    answers = {offer.key: [Answer(offer.node, "expired", 0.001, {})] for offer in SERVICE}
    well = Survey(0.001, 2.0, NODES, TOPIC + SERVICE, messages, answers)
    return replace(well, **changes)


def verdict(check: Finding) -> str:
    assert check.evidence
    assert check.fix or check.verdict == "PASS"
    return check.verdict


@pytest.mark.parametrize(
    ("expected", "text", "count", "hz", "declared", "seconds"),
    [
        ("PASS", "100.0 Hz of 100", 200, 100.0, 100.0, 2.0),
        ("PASS", "85.0 Hz of 100", 170, 85.0, 100.0, 2.0),
        ("WARN", "70.0 Hz of 100", 140, 70.0, 100.0, 2.0),
        ("WARN", "200.0 Hz of 100", 400, 200.0, 100.0, 2.0),
        ("WARN", "4.0 Hz of 100", 8, 4.0, 100.0, 2.0),
        ("FAIL", "nothing came in 2.2 s", 0, 1.0, 100.0, 2.2),
        ("FAIL", "nothing came in 2.2 s", 0, 1.0, 1.0, 2.2),
        ("WARN", "not measured: 1 messages", 1, 10.0, 10.0, 1.0),
        ("PASS", "too slow to measure in 0.4 s", 0, 1.0, 1.0, 0.4),
        ("PASS", "too slow to measure in 2.2 s", 1, 0.1, 0.1, 2.2),
    ],
)
def test_a_topics_rate_is_judged_against_its_declared_rate(
    expected: str, text: str, count: int, hz: float, declared: float, seconds: float
):
    check = bus.topic(replace(POSE, hz=declared), arrivals(count, hz), seconds)
    assert verdict(check) == expected
    assert text in check.evidence


def test_a_state_may_be_published_more_often_but_not_less():
    state = replace(POSE, hz=10.0)
    often, seldom = (bus.topic(state, arrivals(40, hz), 2.0, at_least=True) for hz in (20.0, 7.0))
    assert (verdict(often), verdict(seldom)) == ("PASS", "WARN")
    assert often.evidence == "40 in 2.0 s: 10 Hz and each change"


def test_at_another_speed_rates_use_simulated_time():
    fast = {o.key: arrivals(int(10 * o.hz) + 1, 5 * o.hz, pace=5.0) for o in TOPIC if o.hz}
    answers = {"uav/@srv/dynamics/get_params": [Answer("d", "", 0.001, {"dynamics.speed": 5.0})]}
    simulated = list(bus.topics(survey(topics=fast, answers=answers), "uav"))
    assert {check.verdict for check in simulated} == {"PASS"}
    rated = [offer for offer in TOPIC if offer.hz and offer.type != "SafetyState"]
    assert sum("(simulated time)" in check.evidence for check in simulated) == len(rated)
    real = list(bus.topics(survey(topics=fast), "uav"))
    assert [check.verdict for check in real].count("WARN") == len(rated)


def test_a_subscription_is_taken_for_no_topic():
    """Safety subscribes to poses that nobody publishes here."""
    wanted = replace(POSE, kind="@sub", node="safety")
    assert list(bus.topics(survey(offers=[wanted]), "uav")) == []


def test_a_second_publisher_fails():
    assert verdict(bus.publishers(survey())) == "PASS"
    announced = bus.publishers(survey(offers=[*TOPIC, replace(POSE, node="mine")]))
    assert verdict(announced) == "FAIL"
    assert "uav/pose is published by dynamics and mine" in announced.evidence
    both = arrivals(20, 10.0)
    both.take(100.5, b"", "b", 0.0)
    silent = bus.publishers(survey(topics={"uav/pose": both}))
    assert verdict(silent) == "FAIL"
    assert "by dynamics and 1 more" in silent.evidence


def test_a_publishers_successor_is_not_a_second_publisher():
    found = arrivals(20, 10.0)
    for number in range(20):
        found.take(103 + number / 10, b"", "b", 0.0)
    assert found.publishers == 1
    assert TopicStats().publishers == 0


def test_clock_offsets_are_warned_about():
    assert verdict(bus.clocks(survey())) == "PASS"
    assert verdict(bus.clocks(survey(topics={}))) == "WARN"
    for age, text in ((0.6, "0.6 s in the past"), (-3.0, "3.0 s in the future")):
        check = bus.clocks(survey(topics={"uav/pose": arrivals(3, 1.0, age=age)}))
        assert verdict(check) == "WARN"
        assert text in check.evidence


@pytest.mark.parametrize(
    ("expected", "text", "readings"),
    [
        ("PASS", "1013.25 hPa, and it changes", [1013.25 + 1e-6 * (n % 3) for n in range(10)]),
        ("PASS", "too few to see", [1013.0] * 7),
        ("WARN", "stuck: 1013 hPa 8 times over", [1012.0] + [1013.0] * 8),
        ("FAIL", "1300 hPa is not the pressure of air", [1013.0] * 8 + [1300.0]),
        ("FAIL", "nan hPa is not", [1013.0, nan]),
        ("WARN", "not checked", []),
    ],
)
def test_a_stuck_or_impossible_pressure_is_found(expected: str, text: str, readings: list[float]):
    check = bus.judged(readings)
    assert (check.verdict, text in check.evidence) == (expected, True), check


def test_barometer_readings_are_checked_without_the_baseline():
    found = TopicStats()
    found.take(100.0, b"garbage", "a", 0.0)
    for number in range(8):
        values = {"stamp": 0.1 * number, "pressure": 0.5, "baseline": 1012.0}
        payload = msgspec.msgpack.encode(values | {"samples": 11, "spread": 0.0})
        found.take(100.0 + number, payload, "a", 0.0)
    (check,) = bus.barometer(survey(topics={"uav/sensors/pressure": found}), "uav")
    assert "stuck: 1012.5 hPa" in check.evidence
    assert list(bus.barometer(survey(topics={}), "uav")) == []


def test_messages_of_unknown_types_have_no_pace():
    found = TopicStats()
    for number, payload in enumerate((b"\xc1", b"text", msgspec.msgpack.encode([1]))):
        found.take(number, payload, "", 0.0)
    assert (found.count, found.hz, found.pace, found.publishers) == (3, 1.0, 0.0, 0)


def test_missing_nodes_and_services_are_found():
    assert verdict(bus.announced(survey(), RUN)) == "PASS"
    missing = bus.announced(survey(nodes=["hub", "dynamics", "safety"]), RUN)
    assert (verdict(missing), missing.evidence) == ("FAIL", "not on the bus: pressure")
    assert verdict(bus.announced(survey(nodes=[]), None)) == "FAIL"
    without = [offer for offer in TOPIC + SERVICE if offer.name != "hold"]
    lacking = bus.announced(survey(offers=without), RUN)
    assert (verdict(lacking), lacking.evidence) == ("WARN", "safety does not offer hold")


def test_a_schema_mismatch_fails():
    assert verdict(bus.schemas(survey())) == "PASS"
    stranger = replace(POSE, type="Camera", hash="deadbeef")
    assert verdict(bus.schemas(survey(offers=[*TOPIC, stranger]))) == "PASS"
    other = bus.schemas(survey(offers=[replace(POSE, hash="deadbeef")]))
    assert verdict(other) == "FAIL"
    assert other.evidence == f"dynamics has Pose#deadbeef, here it is #{POSE.hash}"
    newer = bus.schemas(survey(offers=[replace(POSE, hash=f"deadbeef.{POSE.hash}")]))
    assert verdict(newer) == "PASS"
    assert f"dynamics has Pose#deadbeef.{POSE.hash}" in newer.evidence


def test_a_second_server_of_a_service_fails():
    assert verdict(bus.servers(survey())) == "PASS"
    goto = next(offer for offer in SERVICE if offer.name == GOTO.name)
    announced = bus.servers(survey(offers=[*SERVICE, replace(goto, node="mine")]))
    assert verdict(announced) == "FAIL"
    assert "uav/@srv/goto is served by safety and mine" in announced.evidence
    two = {goto.key: [Answer("a", "expired", 0.1, {}), Answer("b", "", 0.1, {})]}
    assert "by safety and 1 more" in bus.servers(survey(answers=two)).evidence


@pytest.mark.parametrize(
    ("expected", "text", "answers"),
    [
        ("PASS", "goto answer within 2.0 ms", [Answer("a", "expired", 0.002, {})]),
        ("PASS", "goto answer within 2.0 ms", [Answer("a", "invalid", 0.002, {})]),
        ("FAIL", "no answer within 2.0 s from goto", [Answer("", "timeout", 2.0, {})]),
        ("FAIL", "no answer within 2.0 s from goto", []),
        ("FAIL", "fails inside: goto", [Answer("a", "internal", 0.002, {})]),
    ],
)
def test_unanswered_and_failing_services_are_found(expected: str, text: str, answers: list[Answer]):
    (check,) = bus.services(survey(answers={GOTO.key("uav"): answers}))
    assert (verdict(check), check.name) == (expected, "services of safety")
    assert check.evidence == text
