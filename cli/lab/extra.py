"""Verdicts on what the lab's text asks beyond the kit: printed lines, waypoints, own services. Pure."""

import re
from collections.abc import Sequence
from itertools import groupby

from quadctl.cli.lab.flown import (
    Commanded,
    FlownMission,
    distance,
    first_at,
    goal_of,
    pose_at,
    until,
)
from quadctl.cli.lab.rubric import RowVerdict, RubricRow
from quadctl.cli.mission.mission import CallStep
from quadctl.services.airspace.geometry import place_of

STILL = 0.3
"""Metres that a vehicle may drift that refuses a goal."""


def prints(row: RubricRow, log: Sequence[str]) -> RowVerdict:
    """Return whether each line is, whatever the form of its numbers, in a line of the log."""
    printed = [_plain(line) for line in log]
    for line in row.lines:
        if not any(_plain(line) in each for each in printed):
            return RowVerdict(False, f"no line of the node's log has `{line}`")
    return RowVerdict(True, f"the node has logged {', '.join(row.lines)}")


_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")


def _plain(line: str) -> str:
    """Return a line with its numbers in their shortest form, and single spaces."""
    return " ".join(_NUMBER.sub(lambda found: f"{float(found[0]):g}", line).split())


def takes_waypoints(row: RubricRow, flown: FlownMission) -> RowVerdict:
    """Return whether each waypoint, which has no answer, is verified as a requested goal."""
    ends = [step.at for step in row.waypoints[1:]] + [flown.poses[-1].stamp]
    cage, shown = Commanded(flown), ""
    for step, end in zip(row.waypoints, ends, strict=True):
        flight = until(flown, end)
        states = flight.states[first_at(flight.states, step.at) :]
        seen = [name for name, _ in groupby(state.state for state in states)]
        shown = f"{step}: safety/state showed {', '.join(seen) or 'nothing'}"
        permitted = cage.permits_at(step.at, step)
        expected = ["VERIFYING", "MOVING", "HOVERING"] if permitted else ["VERIFYING", "HOVERING"]
        if seen[seen[:1] == ["HOVERING"] :] != expected:
            return RowVerdict(False, shown)
        begun, last = pose_at(flight.poses, step.at), flight.poses[-1]
        drift, away = distance(begun, place_of(last)), distance(last, goal_of(step))
        if permitted and away > (row.within or flown.params.safety.acceptance_range):
            return RowVerdict(False, f"{step}: {away:.2f} m away from it at {end:g} s")
        if not permitted and drift > STILL:
            why = f"{step}: is not permitted, but the vehicle moved {drift:.2f} m"
            return RowVerdict(False, why)
    return RowVerdict(True, shown)


def replies(row: RubricRow, flown: FlownMission) -> RowVerdict:
    """Return whether the reply to the last call has the fields that are expected."""
    *_, (step, reply, problem) = (o for o in flown.outcomes if isinstance(o.step, CallStep))
    if problem is not None:
        return RowVerdict(False, f"{step}: {problem.message}")
    if not isinstance(reply, dict):
        return RowVerdict(False, f"{step}: the reply is {reply!r}, and has no fields")
    for name, value in row.reply.items():
        found = reply.get(name)
        numbers = not isinstance(value, bool | str) and isinstance(found, int | float)
        same = abs(found - value) <= row.within if numbers else found == value
        if not same or isinstance(found, bool) is not isinstance(value, bool):
            return RowVerdict(False, f"{step}: the reply's {name} is {found!r}, not {value!r}")
    return RowVerdict(True, f"{step}: {reply}")
