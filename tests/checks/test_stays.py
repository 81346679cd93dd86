"""Stays of a goal: the functions of safety that hold its x, from the decoded request to the setpoint.

    python -m tests.checks.test_stays

A function holds x if, as it returns, one of its variables or its result is x itself, or a place, a line, a box
or a request with x in it. Each is one more place to read for somebody who follows a goal.
"""

import os
import sys
from pathlib import Path
from types import FrameType
from typing import Any

from msgspec import Struct
from msgspec.structs import astuple, replace

from quadctl.schemas.messages import Called, Setpoint
from quadctl.schemas.params import Params
from quadctl.schemas.topics import POSE
from quadctl.services.runtime.testing import play
from quadctl.services.safety.__main__ import run
from tests.support.worlds import AT_REST

X = 2.718281828
_OWN = (f"services{os.sep}safety", f"services{os.sep}airspace")


def _has_x(value: Any, depth: int = 2) -> bool:
    if isinstance(value, float):
        return value == X
    if isinstance(value, Struct) and depth != 1:
        value = astuple(value) if set(value.__struct_fields__) >= {"x", "y", "z"} else ()
    return (
        isinstance(value, tuple | list) and depth > 0 and any(_has_x(e, depth - 1) for e in value)
    )


def stays() -> list[str]:
    """Return the functions that hold x, in their order."""
    found: dict[str, None] = {}
    done = False

    def watch(frame: FrameType, event: str, result: Any) -> None:
        nonlocal done
        code = frame.f_code
        if done or event != "return" or "<" in code.co_name:
            return
        if not any(own in code.co_filename for own in _OWN):
            return
        if any(_has_x(value) for value in (*frame.f_locals.values(), result)):
            found[f"{Path(code.co_filename).name}: {code.co_qualname}"] = None
        done = isinstance(result, Setpoint) and result.position.x == X

    poses = [(POSE, replace(AT_REST.pose, seq=n, stamp=n / 100)) for n in range(200)]
    goal = {"x": X, "y": 0.0, "z": 1.0, "replace": False}
    sys.setprofile(watch)
    try:
        play(
            "safety",
            run,
            Params(),
            poses,
            [Called(AT_REST.pose.boot, 1.0, "goto", False, goal, {}, "")],
        )
    finally:
        sys.setprofile(None)
    assert done, "no setpoint with x was sent"
    return list(found)


def test_a_goal_stays_in_few_functions():
    """They were 11 before there was one verdict on a goal."""
    assert len(stays()) <= 7


if __name__ == "__main__":
    names = stays()
    print(*names, f"{len(names)} functions", sep="\n")
