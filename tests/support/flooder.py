"""Floods of a vehicle by a client of its own; see `main`."""

import json
import time
import uuid
from collections import Counter
from pathlib import Path
from threading import Semaphore
from typing import Any

import msgspec
import zenoh

from tests.support.intruder import session
from tests.support.running import DEADLINE

CALLS, RATE, SECONDS = 20_000, 40_000, 5.0
PATIENCE = 30.0
"""Time (s) after which a call that the hub had no room for counts as unanswered."""
GOAL = {"x": 1.0, "y": 0.0, "z": 1.0}
SERVICES: dict[str, dict[str, Any]] = {
    "goto": GOAL,
    "hold": {},
    "toggle_cage": {"cage_on": False},
    "calibrate_pressure": {"zero": True},
    "reset": {},
    **{f"{node}/get_params": {"names": []} for node in ("safety", "dynamics", "pressure", "hub")},
    **{f"{node}/set_params": {"values": {}} for node in ("safety", "dynamics", "pressure", "hub")},
}
"""Request of each service."""
FAR = 86_400.0
"""Simulated time (s) that no flight lives to see."""


def call(opened: zenoh.Session, vehicle: str, kind: str) -> Counter[str]:
    """Return how many calls ended how: `ok`, the code of an error, or `unanswered`."""
    ended, open_ = Counter[str](), Semaphore(0)
    state = next(iter(opened.get(f"{vehicle}/safety/state", timeout=DEADLINE))).ok
    assert state is not None
    now = msgspec.msgpack.decode(state.payload.to_bytes())["stamp"]

    def send(service: str, at: float, name: str) -> None:
        replies: list[str] = []

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                replies.append("ok")
            elif reply.err is not None and b'"code"' in (error := reply.err.payload.to_bytes()):
                replies.append(msgspec.json.decode(error)["code"])

        def on_end() -> None:
            ended.update(replies or ["unanswered"])
            open_.release()

        callback: Any = zenoh.handlers.Callback(on_reply, on_end, indirect=False)
        ticket = {"id": name, "deadline": time.time() + PATIENCE, "at": at}
        opened.get(
            f"{vehicle}/@srv/{service}", callback, payload=msgspec.msgpack.encode(SERVICES[service]),
            attachment=msgspec.msgpack.encode(ticket), timeout=PATIENCE,
        )  # fmt: skip

    if kind == "far":
        for service in SERVICES:
            send(service, FAR, uuid.uuid4().hex)
    else:
        for number in range(CALLS):
            after = number / 1000 if kind == "later" else 0.0
            send("goto", now + 5 + after, "the same" if kind == "again" else uuid.uuid4().hex)
    for _ in range(len(SERVICES) if kind == "far" else CALLS):
        assert open_.acquire(timeout=DEADLINE)
    return ended


def publish(opened: zenoh.Session, vehicle: str) -> Counter[str]:
    """Return how many positions were sent."""
    positions = opened.declare_publisher(f"{vehicle}/input/position_request")
    sent, began = 0, time.monotonic()
    while (now := time.monotonic()) < began + SECONDS:
        while sent < RATE * (now - began):
            positions.put(msgspec.msgpack.encode(GOAL | {"x": float(sent % 3)}))
            sent += 1
        time.sleep(0.001)
    return Counter(sent=sent)


def main(endpoint: str, kind: str, vehicle: str, identity: str = "") -> None:
    """Flood a vehicle, and print as JSON how the calls ended, or how many positions were sent.

    `kind` is `later`, `at once` or `again` for 20 000 calls for simulated times: each for another one, all for the
    same, or all the same call; `far` for one to each service for the next day; or `positions` for 40 000 requested positions a second, for 5 s.
    """
    with session(endpoint, Path(identity)) as opened:
        flood = publish(opened, vehicle) if kind == "positions" else call(opened, vehicle, kind)
        print(json.dumps(flood))
