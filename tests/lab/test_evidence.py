"""Evidence of a row that does not hold: its crash, its blocked handler, its wrong reply, and their places."""

import re
import shutil
from pathlib import Path

import pytest

from quadctl.cli.lab import grading
from quadctl.cli.lab.causes import last_cause
from quadctl.cli.lab.machine import KILLED
from tests.support.handins import ARRIVES, GOAL_AHEAD, ROWS, graded, write
from tests.support.lab import Lab


def broken(folder: Path, old: str, new: str) -> Path:
    """Write the completed hand-in with a fault in its safety node, and return its folder."""
    handin = write("completed", folder)
    file = handin / "my_safety.py"
    text = file.read_text("utf-8")
    assert old in text
    file.write_text(text.replace(old, new), "utf-8")
    return handin


@pytest.mark.thorough
def test_a_crash_is_the_first_line_and_costs_the_rows_of_its_node_only(lab: Lab):
    handin = broken(lab.folder, "        away = dist(", "        away = math.dist(")
    shutil.copy(Path(grading.__file__).with_name("rubric.toml"), handin)
    done = lab.quadctl("lab", "check", handin)
    assert done.code == 8, done.err
    live, text = done.out.split("completed: ")
    assert {line.split()[1] for line in live.splitlines() if line.startswith("ok")} == {
        number for number in ROWS if number.startswith("3.")
    }
    first, _, evidence, *more = text.splitlines()
    crash = (
        r" {8}safety (crashed|does not stay up): NameError: .*'math'.* \(my_safety\.py, line \d+\)"
    )
    assert re.fullmatch(crash, evidence), first
    assert not [line for line in more if "hint:" in line or "nobody" in line]
    assert [line for line in more if "in rows that only `lab grade` flies" in line] == more[-2:-1]
    page = (handin / "report/report.html").read_text("utf-8")
    assert "in rows that only `lab grade` flies" in page


@pytest.mark.thorough
def test_a_crash_in_one_row_costs_that_row_only(lab: Lab):
    handin = broken(
        lab.folder, "        self.cage_on = request.cage_on\n", "        import os; os._exit(3)\n"
    )
    # A process that ends quickly five times is left down by the supervisor.
    crashes = [
        f'[[row]]\nname = "crash {n}"\nexpect = "answers"\nend = 5.0\n'
        'rows = [{ at = 4.0, do = "cage", on = false }]\nhint = "look"\n'
        for n in range(6)
    ]
    own = lab.file("".join((*crashes, ARRIVES)), "own.toml")
    found = graded(lab, handin, "--rubric", own)["completed"]
    assert found == {str(n): "safety crashed: exit 3" for n in range(1, 7)}


@pytest.mark.thorough
def test_a_handler_that_blocks_is_named_and_waited_for_twice(lab: Lab):
    handin = broken(
        lab.folder,
        "        goal = Position(request.x",
        "        while True: pass\n        goal = Position(request.x",
    )
    rows = "".join(
        f'[[row]]\nname = "goal {n}"\nexpect = "arrives"\nend = 6.0\n'
        f'rows = [{{ at = 4.0, do = "goto", x = {n}.0, y = 1.0, z = 1.0 }}]\n'
        for n in range(1, 5)
    )
    found = graded(lab, handin, "--rubric", lab.file(rows, "own.toml"))["completed"]
    firsts = [output.splitlines()[0] for output in found.values()]
    named = "safety is blocked: on_goto (my_safety.py, line 43) has not returned for 2 s"
    assert all(named in first for first in firsts), firsts
    assert [first.startswith("not flown") for first in firsts] == [False, False, True, True]


@pytest.mark.thorough
def test_a_crash_after_a_slow_start_is_no_blocked_loop(lab: Lab):
    handin = broken(
        lab.folder,
        "        goal = Position(",
        "        import os; os._exit(3)\n        goal = Position(",
    )
    file = handin / "my_safety.py"
    slow = "        import time; time.sleep(2.6)\n        self.take_off()\n        node."
    text = file.read_text("utf-8").replace("        self.take_off()\n        node.", slow)
    file.write_text(text, "utf-8")
    found = graded(lab, handin, "--rubric", lab.file(GOAL_AHEAD, "own.toml"))["completed"]
    assert found["1"].splitlines()[0] == "safety crashed: exit 3"


@pytest.mark.thorough
def test_a_limit_that_ends_a_node_is_the_first_line(lab: Lab):
    handin = broken(
        lab.folder,
        "        goal = Position(request.x",
        "        import hashlib, threading\n"
        "        spin = lambda: [hashlib.sha256(bytes(1 << 20)) for _ in iter(int, 1)]\n"
        "        threading.Thread(target=spin, daemon=True).start()\n"
        "        goal = Position(request.x",
    )
    rubric = lab.file(GOAL_AHEAD.replace("9.0", "900.0"), "own.toml")
    found = graded(lab, handin, "--rubric", rubric, "--seconds", 3)["completed"]
    cause = "killed by its limit: 3 s of processor time"
    assert found["1"].splitlines() == [f"safety crashed: {cause}", f"safety: {cause}"]


ODD = """
from quadctl.schemas.services import GetParamsResponse
from quadctl.services.runtime.params.live import LiveParams
odd = [GetParamsResponse({})]
def get(self, request, before=LiveParams.get):
    return odd.pop() if odd else before(self, request)
LiveParams.get = get
"""
"""First answer about the parameters that names none of them."""


@pytest.mark.thorough
def test_an_answer_that_ours_does_not_give_costs_its_row_only(lab: Lab):
    handin = broken(lab.folder, "\nclass Safety", f"{ODD}\nclass Safety")
    rows = GOAL_AHEAD + GOAL_AHEAD.replace("flies", "flies again")
    found = graded(lab, handin, "--rubric", lab.file(rows, "own.toml"))["completed"]
    why = "not judged: an answer of safety is not as our own node's: KeyError: 'safety.cage_on'"
    assert found == {"1": why}


@pytest.mark.thorough
def test_a_wrong_reply_names_its_handler(lab: Lab):
    handin = broken(lab.folder, "        return ToggleCageResponse(True)\n", "")
    row = (
        '[[row]]\nname = "toggles"\nexpect = "answers"\nend = 5.0\n'
        'rows = [{ at = 4.0, do = "cage", on = false }]\n'
    )
    found = graded(lab, handin, "--rubric", lab.file(row, "own.toml"))["completed"]
    assert found["1"].startswith(
        "safety failed: TypeError: Safety.on_toggle (my_safety.py, line 57) returned None, not a"
        " ToggleCageResponse"
    )


@pytest.mark.thorough
def test_a_pose_that_safety_does_not_answer_is_named(lab: Lab):
    handin = broken(
        lab.folder, "        self.setpoints.put(", "        if pose.seq < 100: self.setpoints.put("
    )
    found = graded(lab, handin, "--rubric", lab.file(GOAL_AHEAD, "own.toml"))["completed"]
    assert "time stopped at 1 s; safety owes a setpoint for pose 100: the last one" in found["1"]


SYNTAX = """\
  File "/handin/sub/a.py", line 111
    def f(:
          ^
SyntaxError: invalid syntax
"""
IN_OURS = """\
Traceback (most recent call last):
  File "/mine/my_safety.py", line 9, in <module>
    start("safety", run)
  File "/lib/quadctl/entry.py", line 3, in start
    run()
KeyError: 'x'
afterwards: more
"""
CHAINED = """\
Traceback (most recent call last):
  File "/mine/a.py", line 1, in f
    g()
OSError: first

During handling of the above exception, another exception occurred:

Traceback (most recent call last):
  File "/lib/b.py", line 2, in h
    raise
quadctl.errors.Invalid
"""


@pytest.mark.parametrize(
    ("log", "error"),
    [
        ("", ""),
        ("flying\nValueError: of my own words", ""),
        (SYNTAX, "SyntaxError: invalid syntax (sub/a.py, line 111)"),
        (
            SYNTAX.replace("/handin", "/tmp/quadctl-lab-a_1/root/12/handin"),
            "SyntaxError: invalid syntax (sub/a.py, line 111)",
        ),
        (IN_OURS, "KeyError: 'x' (my_safety.py, line 9)"),
        (f"{IN_OURS}{KILLED}64 MB of memory", f"{KILLED}64 MB of memory"),
        (CHAINED, "quadctl.errors.Invalid (b.py, line 2)"),
    ],
)
def test_the_last_cause_in_a_log_has_its_place_in_the_hand_in(log: str, error: str):
    assert last_cause(log.splitlines(), Path("/mine")) == error
