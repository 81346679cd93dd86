"""One managed process, with a stand-in for its child."""

import errno
from typing import cast

from quadctl.services.runtime.process_table import GRACE, SETTLED, START_TIMEOUT, Process
from quadctl.services.runtime.supervisor.child import Child, LogLine
from quadctl.services.runtime.supervisor.supervisor import ManagedProcess


class FakeChild:
    """Child that runs until its exit code is set."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.code: int | None = None
        self.written: list[str] = []
        self.done: list[str] = []

    def exit_code(self) -> int | None:
        return self.code

    def terminate(self) -> None:
        self.done.append("terminate")

    def kill(self) -> None:
        self.done.append("kill")

    def wait(self, _timeout: float) -> bool:
        self.code = -9
        return True

    def last_words(self) -> str:
        return f"exit {self.code}"

    def take_lines(self) -> list[LogLine]:
        lines, self.written = self.written, []
        return [LogLine(0.0, "x", line) for line in lines]


class Rig:
    """Managed process and the children that it has started."""

    def __init__(self, *, must_announce: bool, patience: float = 0.0) -> None:
        self.children: list[FakeChild] = []
        self.exhausted = False
        self.row = ManagedProcess(
            Process("x", ("x",), must_announce, not must_announce, patience=patience), self.spawn
        )

    def spawn(self, _process: Process, _restarts: int) -> Child:
        if self.exhausted:
            raise OSError(errno.EMFILE, "Too many open files")
        self.children.append(FakeChild(100 + len(self.children)))
        return cast("Child", self.children[-1])

    def turn(self, now: float, *, offline: bool = False) -> str:
        """Update the process, and return its state."""
        self.row.update(now, offline=offline, timeout=2.0)
        return self.row.life.state

    def log_lines(self) -> list[str]:
        return [line.line for line in self.row.take_output()]


def test_a_restart_ends_the_process_and_waits_for_its_successor():
    rig = Rig(must_announce=False)
    assert [rig.turn(now) for now in (0.0, SETTLED / 2, SETTLED)] == ["starting"] * 2 + ["ready"]
    (old,) = rig.children
    rig.row.restart(10.0, "restart requested")
    rig.row.restart(10.0, "restart requested")
    assert rig.log_lines() == ["x: restart requested"]
    assert old.done == ["terminate"]
    rig.row.announced(10.1)
    assert rig.turn(10.1) == "restarting"
    assert rig.turn(10.0 + GRACE) == "restarting"
    assert old.done == ["terminate", "kill"]
    old.code = -9
    assert [rig.turn(11.0), rig.turn(11.0)] == ["restarting"] * 2
    assert rig.turn(11.0 + SETTLED) == "ready"
    record = rig.row.record()
    assert (record.pid, record.restarts) == (101, 1)
    assert record.started > 1e9
    assert rig.log_lines() == []


def test_while_the_name_is_taken_only_the_first_try_is_logged():
    rig = Rig(must_announce=True)
    logged = []
    for now in range(5):
        rig.turn(float(now))
        rig.children[-1].written.append("taken")
        logged += rig.log_lines()
        rig.children[-1].written.append("by process 7")
        rig.children[-1].code = 7
        rig.turn(float(now))
        logged += rig.log_lines()
    assert logged == [
        "taken",
        "by process 7",
        "x ended (exit 7): another process has its name; retrying every 0.8 s",
    ]
    rig.turn(9.0)
    rig.children[-1].written.append("at last")
    assert rig.log_lines() == []
    rig.row.announced(9.1)
    assert rig.log_lines() == ["at last"]


def test_the_last_lines_of_a_process_come_before_its_end():
    rig = Rig(must_announce=True)
    rig.turn(0.0)
    rig.children[0].written.append("no wings")
    rig.children[0].code = 3
    assert rig.turn(0.1) == "restarting"
    assert rig.log_lines() == ["no wings", "x ended (exit 3): restarting in 0 s"]
    assert rig.children[0].done == ["kill"], "its descendants are killed too"


def test_a_process_that_cannot_be_started_is_tried_again():
    rig = Rig(must_announce=True)
    rig.turn(0.0)
    rig.children[0].code, rig.exhausted = -9, True
    assert [rig.turn(0.1), rig.turn(0.2)] == ["restarting"] * 2
    assert rig.log_lines() == [
        "x ended (exit -9): restarting in 0 s",
        "x cannot be started (Too many open files): restarting in 0.1 s",
    ]
    rig.exhausted = False
    rig.turn(0.31)
    assert rig.row.record().pid == 101
    rig.children[1].code, rig.exhausted = -9, True
    assert [rig.turn(now) for now in (1.0, 2.0, 3.0)][-1] == "down"
    assert rig.log_lines()[-1] == "x cannot be started (Too many open files): left down"


def test_a_process_with_patience_may_be_silent_for_longer():
    rig = Rig(must_announce=True, patience=10.0)
    rig.turn(0.0)
    rig.row.announced(0.1)
    rig.row.answered(0.2)
    assert [rig.turn(now) for now in (2.3, 10.1)] == ["ready"] * 2
    assert rig.turn(10.3) == "restarting"
    assert rig.log_lines()[0] == "x: no answer for 10 s: killed"


def test_a_process_is_not_killed_while_the_supervisor_is_deaf():
    rig = Rig(must_announce=True)
    rig.turn(0.0)
    rig.row.announced(0.1)
    assert rig.turn(9.0, offline=True) == "ready"
    assert [rig.turn(now) for now in (9.1, 10.9)] == ["ready"] * 2
    assert rig.turn(11.1) == "restarting"


def test_the_time_to_be_ready_counts_from_the_last_progress():
    rig = Rig(must_announce=True)
    rig.turn(0.0)
    for now in (9.0, 18.0, 27.0):
        rig.row.progressed(now)
        rig.turn(now)
    assert rig.children[0].done == []
    rig.turn(27.0 + START_TIMEOUT)
    assert rig.children[0].done[0] == "kill"
    assert rig.log_lines()[0] == "x: not ready in 10 s: killed"
