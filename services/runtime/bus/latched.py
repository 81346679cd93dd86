"""Asking for what a latched topic holds."""

import time
from typing import TypeVar

import zenoh
from msgspec import Struct

from schemas.contract import Topic
from services.runtime.bus import wire
from services.runtime.errors import Invalid, QuadctlError, TimedOut, Unreachable

M = TypeVar("M", bound=Struct)

_AGAIN = 0.02
"""Seconds after which one is asked again who was not there: a restart takes a tenth of one."""


def latest(session: zenoh.Session, topic: Topic[M], key: str, timeout: float) -> M:
    """The last message of a topic.

    Raises Unreachable where nobody answers within the timeout (s), TimedOut where who is there does
    not, and Invalid where only what cannot be read has come.
    """
    deadline = time.monotonic() + timeout
    why: QuadctlError = Unreachable(
        f"nobody answered for {key} within {timeout:g} s",
        f"is {topic.node} up? `quadctl status` shows it",
    )
    while (left := deadline - time.monotonic()) > 0:
        # Of all who answer: a stranger's nonsense must not hide the topic's own reply.
        for reply in session.get(
            key,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=left,
        ):
            if reply.ok is None:
                if isinstance(why, Invalid):
                    continue  # that something came says more than that no more did
                why = TimedOut(
                    f"{topic.node} did not answer within {timeout:g} s",
                    "its process is busy or frozen: `quadctl status` shows which",
                )
                continue
            try:
                payload, said = reply.ok.payload.to_bytes(), str(reply.ok.encoding)
                return wire.decode(topic.type, payload, said)
            except Invalid as problem:
                why = wire.unreadable(key, problem)
        # Nobody answers for the key yet.
        time.sleep(max(min(deadline - time.monotonic(), _AGAIN), 0))
    raise why
