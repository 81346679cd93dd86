"""`state --watch` prints each change of state when it arrives."""

import json
import re
import signal
from functools import partial

import pytest

from tests.support.bare import Bare, pack
from tests.support.lab import Lab
from tests.support.running import Foreground, eventually

LINE = re.compile(r"\d+\.\d\d s  ([A-Z]+)  goal (\S+ \S+ \S+)  cage (on|off)(?:  (.+))?")


@pytest.mark.thorough
def test_each_change_of_state_is_one_line(shared_lab: Lab, hover: Bare):
    text = shared_lab.spawn(*shared_lab.command("state", "--watch"))
    rows = shared_lab.spawn(*shared_lab.command("state", "--watch", "--json"))
    eventually(lambda: text.log and rows.log)
    states = hover.watch("uav/safety/state")
    # The state is published each second without a change: this must print no further line.
    states.next(2)
    assert len(text.log.splitlines()) == len(rows.log.splitlines()) == 1
    hover.fly(1.0, 0.0, 1.0)
    assert hover.call("goto", x=9.0, y=0.0, z=1.0).value["accepted"] is False
    for process in (text, rows):
        eventually(partial(has_the_refusal, process))
        process.send(signal.SIGINT)
        assert process.wait() == 130
    found = [LINE.fullmatch(line) for line in text.log.splitlines()]
    assert all(found)
    states_and_goals = [(match[1], match[2]) for match in found if match]
    assert states_and_goals[0] == ("HOVERING", "0 0 1")
    flight = [name for name, goal in states_and_goals if goal == "1 0 1"]
    assert flight[-2:] == ["VERIFYING", "HOVERING"]
    assert "MOVING" in flight
    documents = [json.loads(line) for line in rows.log.splitlines()]
    assert [row["state"] for row in documents] == [name for name, _ in states_and_goals]
    assert all(row["pose"]["boot"] == row["boot"] for row in documents)
    assert documents[-1]["pose"]["position"]["x"] > 0.5


def has_the_refusal(process: Foreground) -> bool:
    return "x = 9" in process.log


def test_watch_ends_when_the_states_stop(shared_lab: Lab, bare: Bare):
    state = pack(bare.state())
    server = bare.session.declare_queryable(
        "drone/safety/state",
        lambda query: query.reply("drone/safety/state", state),
        complete=True,
    )
    done = shared_lab.quadctl("state", "--watch", "--vehicle", "drone", "--timeout", 0.5)
    assert done.code == 3
    assert LINE.fullmatch(done.out.rstrip())
    assert "nothing came on drone/safety/state within 0.5 s" in done.err
    server.undeclare()


@pytest.mark.thorough
def test_watch_ends_soon_after_its_reader_without_a_change(shared_lab: Lab, hover: Bare):
    watch = " ".join(map(str, shared_lab.command("state", "--watch", "--json")))
    piped = shared_lab.spawn("sh", "-c", f"{watch} | head -1")
    assert piped.wait() == 0
    assert len(piped.log.splitlines()) == 1
