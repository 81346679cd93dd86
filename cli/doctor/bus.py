"""Checks of the bus: nodes, schemas, services, topics, clocks and the barometer."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from quadctl.cli.context import own_topic
from quadctl.cli.doctor.check import Finding, failed, no_duplicates, passed, warned
from quadctl.cli.doctor.run import Settings, faults, parameters
from quadctl.schemas.barometer import AIR
from quadctl.schemas.digests import go_together
from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.schemas.messages import Pressure
from quadctl.schemas.params import in_lockstep
from quadctl.schemas.topics import (
    INFO,
    MESSAGES,
    POSE,
    POSE_SLOW,
    PRESSURE,
    SERVICES,
    SETPOINT,
    STATE,
    Service,
    Topic,
    get_params,
    set_params,
)
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.diagnosis import NOT_OFFERED_FIX, not_offered
from quadctl.services.runtime.bus.survey import Survey, TopicStats
from quadctl.services.runtime.errors import Invalid, QuadctlError, TimedOut
from quadctl.services.runtime.process_table import NODES
from quadctl.services.runtime.run_files import RunState

_ALIKE = 8
"""Readings, equal to the last bit, that show a stuck sensor: each has noise, and even the coarsest
gives so many equal ones only once in ten thousand times."""
_FIX = "`quadctl fault list`, `quadctl node restart pressure`; check the wires of a real sensor"


def barometer(found: Survey, vehicle: str) -> Iterator[Finding]:
    """Check that the barometer, if any, has readings of air that change."""
    stats = found.topics.get(PRESSURE.key(vehicle))
    if stats is not None:
        yield judged(_readings(stats.newest))


def judged(readings: Sequence[float]) -> Finding:
    """Judge readings, hPa, the oldest first."""
    if not readings:
        return warned("barometer", "not checked: no reading came")
    low, high = AIR
    if beyond := [reading for reading in readings if not low <= reading <= high]:
        evidence = f"{beyond[-1]:g} hPa is not the pressure of air: it is {low:g} to {high:g} hPa"
        return failed("barometer", evidence, _FIX)
    if len(readings) < _ALIKE:
        return passed("barometer", f"{readings[-1]:.6g} hPa; too few to see whether it is stuck")
    if len(set(readings[-_ALIKE:])) == 1:
        evidence = f"stuck: {readings[-1]:.9g} hPa {_ALIKE} times over, with no noise"
        return warned("barometer", evidence, _FIX)
    return passed("barometer", f"{readings[-1]:.6g} hPa, and it changes")


def _readings(payloads: Iterable[bytes]) -> list[float]:
    """Return the measured pressures (hPa), baseline included; skip unreadable messages."""
    found = []
    for payload in payloads:
        try:
            reading = codec.decode_fields(Pressure, payload)
        except Invalid:
            continue
        found.append(reading.pressure + reading.baseline)
    return found


_SERVED: tuple[Service[Any, Any], ...] = (*SERVICES, get_params(""), set_params(""))
_TYPES = MESSAGES | {service.type_name: service.request for service in _SERVED}
_HASHES = {name: codec.digest(type_) for name, type_ in _TYPES.items()}


_NEEDED = (POSE, POSE_SLOW, PRESSURE, STATE, SETPOINT, INFO)
"""Topics without which another process or a command misses something, whatever stands in for a node."""


def announced(found: Survey, run: RunState | None) -> Finding:
    """Check that every node recorded as ready has announced itself and its endpoints."""
    due = [node.name for node in run.nodes if node.state == "ready"] if run else []
    missing = [name for name in due if name not in found.nodes and name in NODES]
    if missing:
        fix = f"`quadctl node restart {missing[0]}`"
        return failed("announced", f"not on the bus: {', '.join(missing)}", fix)
    if not found.nodes:
        return failed("announced", "no node is on the bus", "`quadctl up -d`")
    offered = {offer.name for offer in found.offers if offer.kind != "@sub"}
    needed: tuple[Any, ...] = (*SERVICES, *_NEEDED)
    lacking = [
        not_offered(entry.node, entry.name)
        for entry in needed
        if entry.node in found.nodes and entry.name not in offered
    ]
    if lacking:
        return warned("announced", ", ".join(lacking), NOT_OFFERED_FIX)
    return passed("announced", ", ".join(found.nodes))


def schemas(found: Survey) -> Finding:
    """Check that the lab's types, as the nodes announce them, go together with those known here."""
    others = {
        f"{offer.node} has {offer.type}#{offer.hash}, here it is #{ours}": go_together(
            offer.hash, ours
        )
        for offer in found.offers
        if offer.hash != (ours := _HASHES.get(offer.type, offer.hash))
    }
    if bad := sorted(text for text, fits in others.items() if not fits):
        fix = "install the same version on both sides: `quadctl --version`, then `quadctl up -d`"
        return failed("schemas", "\n".join(bad), fix)
    count = len({offer.key for offer in found.offers})
    if others:
        other = "go together; of other versions:"
        return passed(
            "schemas", "\n".join([f"{count} topics and services {other}", *sorted(others)])
        )
    return passed("schemas", f"{count} topics and services have the fields known here")


def messages(found: Survey, vehicle: str) -> Finding:
    """Check that the messages of the vehicle's topics have the fields and values of their types."""
    wrong, count = [], 0
    for key, stats in sorted(found.topics.items()):
        topic = own_topic(key, vehicle)
        if topic is None:
            continue
        problems = list(filter(None, (_problem(topic, payload) for payload in stats.newest)))
        count += len(stats.newest)
        if problems:
            wrong.append(f"{key}: {problems[-1]}; {len(problems)} of {len(stats.newest)} messages")
    if wrong:
        fix = "`quadctl topic info TOPIC` shows the fields; `quadctl topic list` shows who publishes it"
        return failed("messages", "\n".join(wrong), fix)
    return passed("messages", f"{count} have the fields and values of their types")


def _problem(topic: Topic[Any], payload: bytes) -> str:
    try:
        codec.decode_fields(topic.type, payload)
    except Invalid as problem:
        return problem.message
    return ""


def servers(found: Survey) -> Finding:
    """Check that each service has one server, by announcements and by answers to a call."""
    answering = {
        key: len({answer.server for answer in answers if answer.server})
        for key, answers in found.answers.items()
    }
    keys = {offer.key for offer in found.offers if offer.kind == "@srv"}
    duplicates = _duplicates(found, "@srv", "served", answering)
    return no_duplicates("servers", duplicates, f"one for each of {len(keys)} services")


def _duplicates(found: Survey, kind: str, done: str, seen: Mapping[str, int]) -> list[str]:
    """Return the keys that several nodes announce, or that more serve (`seen`) than announce."""
    offers = [offer for offer in found.offers if offer.kind == kind]
    duplicates: list[str] = []
    for key in sorted({offer.key for offer in offers}):
        nodes = [offer.node for offer in offers if offer.key == key]
        if len(nodes) > 1:
            duplicates.append(f"{key} is {done} by {' and '.join(nodes)}")
        elif (others := seen.get(key, 0) - 1) > 0:
            duplicates.append(f"{key} is {done} by {nodes[0]} and {others} more, not announced")
    return duplicates


def services(found: Survey) -> Iterator[Finding]:
    """Check that the services of each node answer."""
    keys = {offer.key: offer for offer in found.offers if offer.key in found.answers}
    for node in sorted({offer.node for offer in keys.values()}):
        yield _services(node, [key for key, offer in keys.items() if offer.node == node], found)


def _services(node: str, keys: list[str], found: Survey) -> Finding:
    title, names = f"services of {node}", {o.key: o.name for o in found.offers}
    silent = [
        names[key] for key in keys if not [a for a in found.answers[key] if a.code != TimedOut.code]
    ]
    if silent:
        evidence = f"no answer within {found.listened:.1f} s from {', '.join(silent)}"
        return failed(title, evidence, f"`quadctl node logs {node}`, `quadctl node restart {node}`")
    internal = [names[key] for key in keys if any(a.code == "internal" for a in found.answers[key])]
    if internal:
        return failed(title, f"fails inside: {', '.join(internal)}", f"`quadctl node logs {node}`")
    longest = max(answer.seconds for key in keys for answer in found.answers[key])
    evidence = ", ".join(names[key].removeprefix(f"{node}/") for key in keys)
    return passed(title, f"{evidence} answer within {1000 * longest:.1f} ms")


_TOLERANCE = 0.2
_FEW = 1.5
"""Messages due in the measured time; if fewer are due, silence proves nothing."""
_CLOCKS = 0.5
"""Seconds that two clocks may differ."""


def running_values(found: Survey) -> dict[str, Any]:
    """Return the parameters that the nodes have reported, by dotted name."""
    replies = (answer.values for answers in found.answers.values() for answer in answers)
    return {name: value for values in replies for name, value in values.items()}


def timing(values: Mapping[str, Any]) -> Finding:
    """Report the time of the run, which decides what a silence does and whether missions fly in it."""
    if "dynamics.speed" not in values:
        return passed("time", "real time: nothing simulates")
    if not in_lockstep(values):
        return passed("time", "real time")
    speed = values["dynamics.speed"]
    return passed("time", f"lock-step, at speed {speed:g}: the clock waits for safety")


def promises(values: Mapping[str, Any]) -> Finding:
    """Report whether the promises on flights hold for the vehicle's body and gains."""
    if values.get("dynamics.unproven"):
        evidence = (
            "no promise holds: `dynamics.unproven` permits bodies and gains that were never flown"
        )
        return warned("promises", evidence, "values near a body of docs/explanation/safety.md")
    return passed("promises", "body and gains are near those that were flown")


def topics(found: Survey, vehicle: str) -> Iterator[Finding]:
    """Check every topic with a declared rate."""
    waits = in_lockstep(running_values(found))
    # Simulated seconds per second, by the vehicle's own stamps.
    pace = found.topics.get(POSE.key(vehicle), TopicStats()).pace
    offers = {offer.key: offer for offer in found.offers if offer.kind == "@pub" and offer.hz}
    for key, offer in offers.items():
        # Safety publishes its state by the wall clock, and on each change.
        at_least = key == STATE.key(vehicle)
        in_time = pace if waits and not at_least else 1.0
        yield topic(offer, found.topics[key], found.listened, in_time, at_least=at_least)


def topic(
    offer: EndpointInfo,
    stats: TopicStats,
    seconds: float,
    pace: float = 1.0,
    *,
    at_least: bool = False,
) -> Finding:
    """Check one topic's declared rate; with a `pace` other than 1, in simulated time."""
    name, due = f"topic {offer.key}", seconds * offer.hz * pace
    if not stats.count and due >= _FEW:
        evidence = f"nothing came in {seconds:.1f} s, {offer.node} declares {offer.hz:g} Hz"
        fix = f"`quadctl node logs {offer.node}`, `quadctl node restart {offer.node}`"
        return failed(name, evidence, fix)
    if not stats.hz or not pace:
        if due < 2 * _FEW:
            return passed(name, f"{offer.hz:g} Hz declared: too slow to measure in {seconds:.1f} s")
        evidence = f"not measured: {stats.count} messages in {seconds:.1f} s"
        return warned(name, evidence, "`quadctl doctor --timeout 10` listens longer")
    measured = stats.hz / pace
    evidence = f"{measured:.1f} Hz of {offer.hz:g}" + (" (simulated time)" if pace != 1 else "")
    share = measured / offer.hz
    if abs(share - 1) <= _TOLERANCE:
        return passed(name, evidence)
    if at_least and share > 1:
        # A few in a row, e.g. at a restart, are no rate.
        return passed(name, f"{stats.count} in {seconds:.1f} s: {offer.hz:g} Hz and each change")
    if share > 1:
        return warned(name, evidence, "`quadctl topic list` shows who publishes it")
    # Only a warning: the system is made to survive an overloaded machine.
    return warned(name, evidence, f"`top` shows what else runs; `quadctl node logs {offer.node}`")


def publishers(found: Survey) -> Finding:
    """Check that each topic has one publisher, by announcements and by messages' stamps."""
    counts = {key: stats.publishers for key, stats in found.topics.items()}
    duplicates = _duplicates(found, "@pub", "published", counts)
    return no_duplicates("publishers", duplicates, f"one on each of {len(found.topics)} topics")


def clocks(found: Survey) -> Finding:
    """Check that the clocks that stamp messages agree with ours."""
    if not found.topics:
        return warned("clocks", "not checked: no node publishes anything", "`quadctl node list`")
    key, stats = max(found.topics.items(), key=lambda item: abs(item[1].age))
    if abs(stats.age) <= _CLOCKS:
        return passed("clocks", f"messages are {1000 * stats.age:.1f} ms old at most")
    evidence = f"{abs(stats.age):.1f} s {'in the past' if stats.age > 0 else 'in the future'}"
    fix = "`timedatectl set-ntp true` on both machines; on one machine, `quadctl topic list`"
    return warned("clocks", f"a message on {key} is stamped {evidence}", fix)


_NEED_THE_HUB = (
    "announced", "schemas", "messages", "servers", "publishers", "topics", "services", "clocks", "barometer",
    "time", "parameters",
)  # fmt: skip


def bus(
    found: Survey | QuadctlError, run: RunState | None, settings: Settings, vehicle: str
) -> Iterator[Finding]:
    """Run all checks of the bus; without an answer of the hub, those that need it do not PASS."""
    if isinstance(found, QuadctlError):
        fix = "`quadctl node logs hub`, `quadctl node restart hub`" if run else found.hint
        yield failed("hub answers", found.message, fix)
        for name in _NEED_THE_HUB:
            yield warned(name, "not checked: the hub does not answer")
        return
    yield passed("hub answers", f"{1000 * found.connected:.1f} ms")
    yield announced(found, run)
    yield schemas(found)
    yield messages(found, vehicle)
    yield servers(found)
    yield publishers(found)
    yield from topics(found, vehicle)
    yield from services(found)
    yield clocks(found)
    yield from barometer(found, vehicle)
    running = running_values(found)
    yield timing(running)
    yield promises(running)
    yield parameters(settings, running)
    yield faults(running)
