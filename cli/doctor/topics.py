"""Judges what comes on the topics: how often, from how many, and by whose clock; pure."""

from collections.abc import Iterator

from cli.doctor.check import Check, alone, failed, passed, warned
from schemas.keyexpr import Offer
from schemas.topics import POSE, STATE
from services.runtime.bus.survey import Heard, Survey

_TOLERANCE = 0.2
_FEW = 1.5
"""Messages that should have come; of fewer, that none came shows nothing."""
_CLOCKS = 0.5
"""Seconds that two clocks may differ."""


def topics(found: Survey, vehicle: str) -> Iterator[Check]:
    """Every topic with a declared rate."""
    speed = _speed(found)
    # Simulated seconds per second, as the vehicle's own stamps tell it.
    pace = found.heard.get(POSE.key(vehicle), Heard()).pace
    offers = {offer.key: offer for offer in found.offers if offer.kind == "@pub" and offer.hz}
    for key, offer in offers.items():
        # Safety's state comes on change too, and else by the wall clock.
        at_least = key == STATE.key(vehicle)
        in_time = 1.0 if speed == 1 or at_least else pace
        yield topic(offer, found.heard[key], found.listened, in_time, at_least=at_least)


def topic(
    offer: Offer, heard: Heard, seconds: float, pace: float = 1.0, *, at_least: bool = False
) -> Check:
    """One topic at its declared rate; a `pace` other than 1 makes it one of simulated time."""
    name, due = f"topic {offer.key}", seconds * offer.hz * pace
    if not heard.count and due >= _FEW:
        return failed(
            name,
            f"nothing came in {seconds:.1f} s, {offer.node} declares {offer.hz:g} Hz",
            f"`quadctl node logs {offer.node}`, `quadctl node restart {offer.node}`",
        )
    if not heard.hz or not pace:
        if due < 2 * _FEW:
            return passed(name, f"{offer.hz:g} Hz declared: too slow to measure in {seconds:.1f} s")
        return warned(
            name,
            f"not measured: {heard.count} messages in {seconds:.1f} s",
            "`quadctl doctor --timeout 10` listens longer",
        )
    measured = heard.hz / pace
    said = f"{measured:.1f} Hz of {offer.hz:g}" + (" (simulated time)" if pace != 1 else "")
    share = measured / offer.hz
    if abs(share - 1) <= _TOLERANCE:
        return passed(name, said)
    if at_least and share > 1:
        # A few in a row, as at a restart, are no rate.
        return passed(
            name, f"{heard.count} in {seconds:.1f} s: each change besides {offer.hz:g} Hz"
        )
    if share > 1:
        return warned(name, said, "`quadctl topic list` shows who publishes it")
    # A machine with too much to do is no fault of the system, which knows how to be late.
    return warned(name, said, f"`top` shows what else runs; `quadctl node logs {offer.node}`")


def publishers(found: Survey) -> Check:
    """One publisher on each topic: announced, and by who stamps the messages."""
    doubled: list[str] = []
    offers = [offer for offer in found.offers if offer.kind == "@pub"]
    for key in sorted({offer.key for offer in offers}):
        nodes = [offer.node for offer in offers if offer.key == key]
        heard = found.heard[key].publishers if key in found.heard else 0
        if len(nodes) > 1:
            doubled.append(f"{key} is published by {' and '.join(nodes)}")
        elif heard > 1:
            doubled.append(f"{key} is published by {nodes[0]} and {heard - 1} more, not announced")
    return alone("publishers", doubled, f"one on each of {len(found.heard)} topics")


def clocks(found: Survey) -> Check:
    """Messages are stamped by clocks that agree with ours."""
    if not found.heard:
        return warned("clocks", "not checked: nobody publishes anything", "`quadctl node list`")
    key, heard = max(found.heard.items(), key=lambda item: abs(item[1].age))
    if abs(heard.age) <= _CLOCKS:
        return passed("clocks", f"messages are {1000 * heard.age:.1f} ms old at most")
    said = f"{abs(heard.age):.1f} s {'in the past' if heard.age > 0 else 'in the future'}"
    return warned(
        "clocks",
        f"a message on {key} is stamped {said}",
        "`timedatectl set-ntp true` on both machines; on one machine, `quadctl topic list`",
    )


def _speed(found: Survey) -> float:
    said = (answer.values for answers in found.answers.values() for answer in answers)
    return next((v["dynamics.speed"] for v in said if "dynamics.speed" in v), 1.0)
