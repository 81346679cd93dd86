"""One row of the table at work, with a child that is none."""

from typing import cast

from quadctl.services.runtime.process_table import GRACE, SETTLED, Process
from quadctl.services.runtime.supervisor.child import Child, LogLine
from quadctl.services.runtime.supervisor.supervisor import ManagedProcess


class Fake:
    """A child that runs until it is told how it ended."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.code: int | None = None
        self.said: list[str] = []
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
        said, self.said = self.said, []
        return [LogLine(0.0, "x", line) for line in said]


class Rig:
    """A row and the children that it has started."""

    def __init__(self, *, must_announce: bool, patience: float = 0.0) -> None:
        self.children: list[Fake] = []
        self.row = ManagedProcess(
            Process("x", ("x",), must_announce, not must_announce, patience=patience), self.spawn
        )

    def spawn(self, _process: Process, _restarts: int) -> Child:
        self.children.append(Fake(100 + len(self.children)))
        return cast("Child", self.children[-1])

    def turn(self, now: float, *, deaf: bool = False) -> str:
        """Look at it; its state then."""
        self.row.update(now, deaf=deaf, answer_timeout=2.0)
        return self.row.life.state

    def said(self) -> list[str]:
        return [said.line for said in self.row.take_said()]


def test_restart_ends_the_process_and_waits_for_its_successor():
    rig = Rig(must_announce=False)
    assert [rig.turn(now) for now in (0.0, SETTLED / 2, SETTLED)] == ["starting"] * 2 + ["ready"]
    (old,) = rig.children
    rig.row.restart(10.0, "restart asked for")
    rig.row.restart(10.0, "restart asked for")
    assert rig.said() == ["x: restart asked for"]
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
    assert rig.said() == []


def test_while_another_has_its_name_only_the_first_try_speaks():
    rig = Rig(must_announce=True)
    told = []
    for now in range(5):
        rig.turn(float(now))
        rig.children[-1].said.append("taken")
        told += rig.said()
        rig.children[-1].said.append("by process 7")
        rig.children[-1].code = 7
        rig.turn(float(now))
        told += rig.said()
    assert told == [
        "taken",
        "by process 7",
        "x ended (exit 7): another process has its name; tried again every 0.8 s",
    ]
    rig.turn(9.0)
    rig.children[-1].said.append("at last")
    assert rig.said() == []
    rig.row.announced(9.1)
    assert rig.said() == ["at last"]


def test_its_last_words_come_before_its_end_is_told():
    rig = Rig(must_announce=True)
    rig.turn(0.0)
    rig.children[0].said.append("no wings")
    rig.children[0].code = 3
    assert rig.turn(0.1) == "restarting"
    assert rig.said() == ["no wings", "x ended (exit 3): restarting in 0 s"]
    assert rig.children[0].done == ["kill"], "what it has started goes with it"


def test_one_with_patience_of_its_own_may_be_silent_for_longer():
    rig = Rig(must_announce=True, patience=10.0)
    rig.turn(0.0)
    rig.row.announced(0.1)
    rig.row.answered(0.2)
    assert [rig.turn(now) for now in (2.3, 10.1)] == ["ready"] * 2
    assert rig.turn(10.3) == "restarting"
    assert rig.said()[0] == "x: no answer for 10 s: killed"


def test_it_is_not_blamed_for_what_could_not_be_heard():
    rig = Rig(must_announce=True)
    rig.turn(0.0)
    rig.row.announced(0.1)
    assert rig.turn(9.0, deaf=True) == "ready"
    assert [rig.turn(now) for now in (9.1, 10.9)] == ["ready"] * 2
    assert rig.turn(11.1) == "restarting"
