"""`lab grade --report` and its rows graded anew, and the sandbox of `lab check`, on real processes."""

import html
import json
import shutil
import signal

import pytest

from tests.support.browser import DESKTOP, PHONE, browser
from tests.support.handins import write
from tests.support.lab import Lab
from tests.support.running import eventually

ONE = (
    '[[row]]\nname = "flies"\nexpect = "arrives"\nend = 7.0\nhint = "look at the goal"\n'
    'rows = [{ at = 4.0, do = "goto", x = 1.0, y = 0.0, z = 1.0 }]\n'
)
TWO = f'{ONE}[[row]]\nname = "random"\nvisible = false\nexpect = "random_flights"\nflights = 1\nseconds = 4.0\n'
CHATTERS = "import sys\nprint('begins', sys.argv, flush=True)\n"


def grade(lab: Lab, *words: object, code: int = 0) -> str:
    """Grade with a report to `out`; return the notes."""
    done = lab.quadctl("lab", "grade", *words, "--report", "out", "--trust", timeout=120.0)
    assert done.code == code, done
    return done.err


@pytest.mark.thorough
def test_a_class_has_a_report_of_each_student_and_a_row_is_graded_anew(lab: Lab):
    good, bad = write("completed", lab.folder), write("never_arrives", lab.folder)
    source = good / "my_safety.py"
    source.write_text(CHATTERS + source.read_text("utf-8"), "utf-8")
    broken = lab.folder / "broken.zip"
    broken.write_text("no zip", "utf-8")
    rubric = lab.file(TWO, "rubric.toml")
    notes = grade(lab, good, bad, broken, "--rubric", rubric, "--seed", 4711)
    assert "drawn from --seed 4711" in notes
    assert "class page: out/index.html" in notes
    out = lab.folder / "out"
    assert {path.name for path in (out / "completed").iterdir()} == {
        "report.html", "results.json", "feedback.txt", "safety.log", "flight.mcap", "flight.png",
    }  # fmt: skip
    assert {path.name for path in (out / "broken").iterdir()} == {
        "report.html", "results.json", "feedback.txt",
    }  # fmt: skip
    log = (out / "completed/safety.log").read_text("utf-8")
    assert log.startswith("== rows 1, 2\nbegins [")
    assert "look at the goal" in (out / "never_arrives/feedback.txt").read_text("utf-8")
    assert lab.quadctl("bag", "check", "out/completed/flight.mcap").code == 0

    # The student hands the right node in, and only the first row is graded anew.
    shutil.copy(source, bad)
    grade(lab, bad, "--row", 1)
    results = json.loads((out / "never_arrives/results.json").read_text("utf-8"))
    assert results["tests"][0]["ok"] is True
    assert len(results["tests"]) == 2
    assert json.loads((out / "class.json").read_text("utf-8"))["seed"] == 4711
    assert (
        "1 of 2" not in (out / "never_arrives/feedback.txt").read_text("utf-8").partition("\n")[0]
    )


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        ("--row 1.11", 2, "--row 1.11: the rubric has no such row"),
        ("--row 1.1 --report out", 6, "out has no results of mine"),
        ("--seed 5 --report made", 6, "--seed 5: the class in made has 4711"),
        ("--rubric mine/rubric.toml --report made", 6, "the class in made has another rubric"),
        ("--report quad.toml", 6, "quad.toml"),
    ],
)
def test_what_does_not_fit_the_class_is_refused(lab: Lab, words: str, code: int, error: str):
    shutil.move(write("completed", lab.folder), lab.folder / "mine")
    (lab.folder / "mine/rubric.toml").write_text(ONE, "utf-8")
    lab.file("", "quad.toml")
    (lab.folder / "made").mkdir()
    record = {"seed": 4711, "rubric": {"row": []}, "students": []}
    (lab.folder / "made/class.json").write_text(json.dumps(record), "utf-8")
    done = lab.quadctl("lab", "grade", "mine", *words.split(), "--trust")
    assert (done.code, done.out) == (code, ""), done
    assert error in done.err
    assert "  try: " in done.err


@pytest.mark.thorough
def test_a_recording_has_the_declared_topics_and_nothing_of_a_students_own(lab: Lab):
    mine = write("completed", lab.folder)
    source = mine / "my_safety.py"
    text = source.read_text("utf-8")
    for old, new in (
        (
            "        self.take_off()\n        node",
            "        self.node = node\n        self.take_off()\n        node",
        ),
        (
            "        self.setpoints.put(",
            "        self.node._session.put('uav/own/x', b'x')\n        self.setpoints.put(",
        ),
    ):
        assert old in text
        text = text.replace(old, new)
    source.write_text(text, "utf-8")
    grade(lab, mine, "--rubric", lab.file(ONE, "rubric.toml"))
    info = lab.quadctl("bag", "info", "out/completed/flight.mcap", "--json").json
    keys = {each["key"] for each in info["keys"] if not each["derived"]}
    assert keys == {"uav/input/position", "uav/pose", "uav/pose/slow", "uav/safety/state"}


SEES = """
import os, sys
print("SEES", os.path.exists({secret!r}), os.environ.get("SECRET"), flush=True)
"""


@pytest.mark.thorough
@pytest.mark.needs("sandbox")
def test_a_check_has_the_sandbox_of_the_grade(lab: Lab):
    mine = write("completed", lab.folder)
    secret = lab.file("points", "secret.txt")
    source = mine / "my_safety.py"
    source.write_text(SEES.format(secret=str(secret)) + source.read_text("utf-8"), "utf-8")
    (mine / "rubric.toml").write_text(ONE, "utf-8")
    done = lab.quadctl("lab", "check", mine, SECRET="points")
    assert done.code == 0, done
    assert "SEES False None" in (mine / "report/safety.log").read_text("utf-8")
    assert lab.quadctl("bag", "check", mine / "report/flight.mcap").code == 0


@pytest.mark.thorough
def test_a_check_says_that_a_folder_could_not_be_graded(lab: Lab):
    mine = write("completed", lab.folder)
    (mine / "rubric.toml").write_text(ONE, "utf-8")
    (mine / "data").symlink_to("/etc")
    done = lab.quadctl("lab", "check", mine)
    assert (done.code, "not gradable: data is a link that leads out of it" in done.out) == (8, True)


@pytest.mark.thorough
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_flights_at_once(lab: Lab, number: signal.Signals):
    mine = write("completed", lab.folder)
    source = mine / "my_safety.py"
    source.write_text(CHATTERS + "import time\ntime.sleep(3000)\n", "utf-8")
    (mine / "rubric.toml").write_text(ONE, "utf-8")
    started = lab.spawn(*lab.command("lab", "check", mine))
    eventually(lambda: list(lab.home.parent.glob("lab-*/run.json")))
    started.send(number)
    assert started.wait() == 128 + number
    eventually(lambda: not lab.processes())


@pytest.mark.thorough
@pytest.mark.needs("browser")
def test_the_pages_fit_a_desktop_and_a_phone(lab: Lab):
    evil = "</pre><script>document.title = 0</script>"
    bad = write("completed", lab.folder)
    text = f"print({evil!r} + 'A' * 500, flush=True)\nraise SystemExit\n"
    (bad / "my_safety.py").write_text(text, "utf-8")
    grade(lab, bad, "--rubric", lab.file(TWO, "rubric.toml"))
    titles = {"index.html": "1 hand-in", "completed/report.html": "completed: 0 of 2 points"}
    with browser() as chromium:
        for name, title in titles.items():
            assert evil[:20] in html.unescape((lab.folder / "out" / name).read_text("utf-8"))
            for size in (DESKTOP, PHONE):
                tab = chromium.tab((lab.folder / "out" / name).as_uri(), size)
                tab.until("document.readyState === 'complete'")
                assert tab.js("document.title") == title
                assert tab.js("document.documentElement.scrollWidth") <= size[0]
                assert tab.js("document.scripts.length") == 0
                assert tab.errors == []
