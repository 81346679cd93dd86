"""`lab new`, `lab check` and `lab grade`, as a student and a teacher use them."""

import csv
import re
import shutil
import signal
import sys
import tempfile
import zipfile
from functools import partial
from pathlib import Path

import pytest

from quadctl.cli.lab import grading, machine
from quadctl.cli.lab.handin import HandIn
from tests.support.archives import below, flipped, zipped
from tests.support.handins import (
    ARRIVES,
    CHEATS,
    GOAL_AHEAD,
    GOOD,
    MISTAKES,
    ROWS,
    STYLES,
    graded,
    promised,
    write,
)
from tests.support.lab import Lab
from tests.support.missions import busy
from tests.support.proofs import Proofs
from tests.support.running import Foreground, eventually

HIDDEN = "5.1"
LAZY = {"3.1", "3.2", "3.3", "3.4", "3.5"}
"""Rows about the other node, which a cheat in safety leaves alone."""

ABOUT_SAFETY = {number for number in (*ROWS, HIDDEN) if not number.startswith("3.")}


@pytest.mark.thorough
def test_a_new_folder_is_checked_from_no_point_to_all(lab: Lab):
    done = lab.quadctl("lab", "new", "mine")
    assert done.code == 0, done.err
    mine = lab.folder / "mine"
    assert {path.name for path in mine.iterdir()} == {
        "LAB.md", "extra.toml", "my_pressure.py", "my_safety.py", "quad.toml", "rubric.toml",
        "test_lab.py",
    }  # fmt: skip
    assert lab.quadctl("lab", "new", "mine").code == 6

    first = lab.quadctl("lab", "check", "mine", "--json")
    assert first.code == 8, first.err
    assert (first.json["ok"], first.json["score"]) == (False, 0)
    assert [test["number"] for test in first.json["tests"]] == ROWS
    assert all(test["output"] for test in first.json["tests"])

    completed = write("completed", lab.folder)
    for name in ("my_safety.py", "my_pressure.py"):
        shutil.copy(completed / name, mine / name)
    last = lab.quadctl("lab", "check", "mine", "--report", "out")
    assert last.code == 0, last.out + last.err
    assert "mine: 33 of 33 points" in last.out
    page = (lab.folder / "out/report.html").read_text("utf-8")
    assert "mine: 33 of 33 points" in page
    assert "data:image/png;base64," in page
    assert lab.quadctl("bag", "check", "out/flight.mcap").code == 0


def shows(process: Foreground, text: str) -> bool:
    return text in process.log


@pytest.mark.thorough
def test_ctrl_c_ends_a_check_and_a_grade_with_what_is_left(lab: Lab):
    write("completed", lab.folder)
    left = {
        "check": ("ok  ", "stopped: the other rows are not flown, and there is no report\n"),
        "grade": ("drawn from", "stopped: 0 of 1 are graded; nothing is written\n"),
    }
    for verb, (begun, text) in left.items():
        done = lab.spawn(*lab.command("lab", verb, "completed"))
        eventually(partial(shows, done, begun))
        done.send(signal.SIGINT)
        assert done.wait() == 130, done.log
        assert done.log.endswith(text), done.log


@pytest.mark.thorough
def test_a_class_is_graded_each_for_itself(lab: Lab):
    folders = [write(name, lab.folder) for name in ("functions", "no_baseline", "exits_at_once")]
    zipped = lab.folder / "zipped.zip"
    with zipfile.ZipFile(zipped, "w") as archive:
        for path in sorted(folders[1].iterdir()):
            archive.write(path, f"inner/{path.name}")
    bad = lab.folder / "bad.zip"
    bad.write_text("no zip", encoding="utf-8")
    found = graded(lab, folders[0], zipped, folders[2], bad, timeout=240)
    assert found["functions"] == {}
    assert found["zipped"].keys() == {"3.2", "3.3"}, found["zipped"]
    assert found["exits_at_once"].keys() == ABOUT_SAFETY
    assert found["exits_at_once"]["2.1"] == "safety does not stay up: it ends, and logs nothing"
    (why,) = set(found["bad"].values())
    assert why.startswith("it is neither a folder, a zip or tar file, nor a .py file; try: ")


@pytest.mark.thorough
def test_all_of_the_labs_text_can_be_graded(lab: Lab):
    extra = Path(grading.__file__).with_name("extra.toml")
    folders = [write(name, lab.folder) for name in ("beyond", "completed")]
    found = graded(lab, *folders, "--rubric", extra)
    assert found["beyond"] == {}
    # The kit alone asks for none of them, but for the launch file's values.
    assert found["completed"].keys() == {"6.1", "6.2", "6.3", "6.5", "6.6", "6.7", "6.8"}
    assert "no line of the node's log has `Param: cage x - [-5, 5]`" in found["completed"]["6.1"]
    assert "safety/state showed HOVERING" in found["completed"]["6.6"]
    assert "own/toggle" in found["completed"]["6.8"]


@pytest.mark.thorough
def test_a_broken_zip_in_a_classs_export_costs_nobody_else_a_mark(lab: Lab):
    files = {path.name: path.read_bytes() for path in write("completed", lab.folder).iterdir()}
    broken = flipped(zipped(files, zipfile.ZIP_STORED), 200)
    nodes = {name: data for name, data in files.items() if name != "quad.toml"}
    export = lab.folder / "export.zip"
    export.write_bytes(
        zipped({
            "Ada_1_assignsubmission_file_/work.zip": zipped(below("mylab", files)),
            "Bob_2_assignsubmission_file_/work.zip": broken,
            **below("Cleo_3_assignsubmission_file_", nodes),
        })
    )  # fmt: skip
    rubric = lab.file(ARRIVES, "rubric.toml")
    done = lab.quadctl(
        "lab", "grade", export, "--rubric", rubric, "--format", "csv", "-o", "points.csv", "--trust",
        timeout=60.0,
    )  # fmt: skip
    assert done.code == 0, done.err
    assert "1 of 3 not gradable" in done.err
    written = (lab.folder / "points.csv").read_text("utf-8")
    rows = list(csv.DictReader(written.splitlines()))
    assert [(row["student"], row["points"]) for row in rows] == [
        ("Ada_1", "1"), ("Bob_2", "0"), ("Cleo_3", "1"),
    ]  # fmt: skip
    assert rows[1]["comment"].startswith("not gradable: it is damaged: Bad CRC-32")
    one = "lab", "grade", export, "--rubric", rubric, "--trust", "--json", "--student"
    alone = lab.quadctl(*one, "Cleo_3", timeout=60.0)
    assert [each["submission"] for each in alone.json] == [f"{export}/Cleo_3"]
    assert (
        lab.quadctl(*one, "Cleo").error["message"] == "--student Cleo: no hand-in is of that name"
    )


@pytest.mark.thorough
def test_a_class_to_try_grading_on_has_the_points_of_the_rubrics_rows(lab: Lab):
    expected = {"completed": 37, "no_baseline": 34, "never_arrives": 9}
    assert {name: promised()[name] for name in expected} == expected
    done = lab.quadctl("lab", "grade", write("no_baseline", lab.folder), "--trust", "--seed", 19)
    assert "no_baseline: 34 of 37" in done.err, done.out


@pytest.mark.thorough
def test_a_goal_10_km_away_with_the_cage_off_need_not_be_reached_in_10_s(lab: Lab):
    """The last goal of a random flight that this seed draws."""
    done = lab.quadctl("lab", "grade", write("completed", lab.folder), "--trust", "--seed", 433_290)
    assert done.code == 0, done.err
    assert "37 of 37 points" in done.out


@pytest.mark.thorough
@pytest.mark.needs("sandbox")
def test_a_hand_in_sees_neither_rubric_nor_solution(lab: Lab):
    # It looks through all files at each of its starts: one row has few.
    hidden = Path(grading.__file__).with_name("hidden.toml")
    handin = write("reads_the_rubric", lab.folder)
    outputs = graded(lab, handin, "--rubric", hidden)["reads_the_rubric"]
    assert outputs.keys() == {HIDDEN}
    assert "FOUND []" in outputs[HIDDEN]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        ("grade nothere", 6, "there is no hand-in nothere"),
        ("grade", 2, "there is no hand-in to grade"),
        ("grade", 2, "give folders or zip files, e.g. `quadctl lab grade handins/*`"),
        ("grade . --format grade", 2, "--format grade: there is no such form"),
        ("grade . . --format github", 2, "--format github is for one hand-in, not 2"),
        ("grade . --rubric nothere.toml", 6, "nothere.toml"),
        ("check nothere", 6, "there is no folder nothere"),
        ("check .", 6, "quad.toml"),
    ],
)
def test_a_wrong_call_is_refused(lab: Lab, words: str, code: int, error: str):
    done = lab.quadctl("lab", *words.split())
    assert done.code == code
    assert error in done.err


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", "names no node under [processes]"),
        (
            '[processes]\ndynamics = "python x.py"\n',
            "processes.dynamics: a hand-in has only safety",
        ),
        pytest.param(
            '[processes]\nsafety = "nothere x.py"\n',
            "nothere was not found",
            marks=pytest.mark.thorough,
        ),
    ],
)
def test_only_safety_and_pressure_may_be_handed_in(lab: Lab, text: str, error: str):
    lab.file(text, "quad.toml")
    lab.file(ARRIVES, "rubric.toml")
    done = lab.quadctl("lab", "check", "--json")
    assert error in done.err + done.out
    assert done.code == (8 if "nothere" in text else 6)


@pytest.mark.prove
@pytest.mark.timeout(3000)
def test_the_rubric_tells_the_mistakes_apart_in_20_runs_of_20(lab: Lab, proofs: Proofs):
    folders = [write(name, lab.folder) for name in (*GOOD, *MISTAKES)]
    expected = dict.fromkeys(GOOD, frozenset[str]()) | {n: m.rows for n, m in MISTAKES.items()}
    assert len(set(expected.values())) == 1 + len(MISTAKES)
    for _ in range(20):
        found = graded(lab, *folders, timeout=300)
        assert found.keys() == expected.keys()
        wrong = {name: rows for name, rows in found.items() if rows.keys() != expected[name]}
        assert not wrong, str(wrong)  # pytest shortens what is no text
    proofs.add(
        f"The rubric tells {len(GOOD)} good hand-ins and {len(MISTAKES)} mistakes apart",
        "20 runs of 20",
        "20 of 20",
    )


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(3000)
def test_right_hand_ins_in_each_style_have_full_marks_in_each_run(lab: Lab, proofs: Proofs):
    folders = [write(name, lab.folder) for name in STYLES]
    for load in (0, 0, 8):
        with busy(load):
            found = graded(lab, *folders, timeout=900)
        assert found == {name: {} for name in STYLES}
    proofs.add(
        f"Right hand-ins in {len(STYLES)} styles, three runs, one beside eight busy processes",
        "each has every point",
        "each",
    )


@pytest.mark.prove
@pytest.mark.needs("sandbox")
@pytest.mark.timeout(900)
def test_no_cheat_gains_a_point_or_disturbs_the_next(lab: Lab, proofs: Proofs):
    folders = [write(name, lab.folder) for name in CHEATS]
    honest = write("completed", lab.folder)
    in_turn = [each for folder in folders for each in (folder, honest)]
    done = lab.quadctl(
        "lab",
        "grade",
        *in_turn,
        "--jobs",
        1,
        "--seconds",
        30,
        "--seed",
        19,
        "--format",
        "json",
        timeout=800,
    )
    assert done.code == 0, done.err
    for cheat, after in zip(done.json[::2], done.json[1::2], strict=True):
        held = {test["number"] for test in cheat["tests"] if test["ok"]}
        assert held <= LAZY, cheat
        assert after["ok"], cheat["submission"]
    assert not lab.processes()
    proofs.add("Cheats that gain a point or disturb the next hand-in", f"0 of {len(CHEATS)}", "0")


@pytest.mark.thorough
def test_what_is_not_its_own_a_hand_in_does_in_vain(lab: Lab):
    """Those that fly nowhere are where they were, as if they had done nothing else."""
    nowhere = ("forges_poses", "sets_the_vehicles_fault", "answers_for_another_node")
    names = (*nowhere, "publishes_poses_of_its_own", "floods_states", "hides_memory")
    folders = [write(name, lab.folder) for name in names]
    found = graded(lab, *folders, "--rubric", lab.file(GOAL_AHEAD, "own.toml"))
    for name in nowhere:
        assert found[name] == {"1": "goto 1 0 1: 1.00 m away from it at the end, more than 0.5 m"}
    assert "not allowed: safety may not publish on uav/pose" in found[names[3]]["1"]
    assert re.match(
        r"safety published \d{5} messages on safety/state until [\d.]+ s: 20 a second are expected",
        found["floods_states"]["1"],
    ), found["floods_states"]
    assert "safety crashed: killed by its limit: 1024 MB of memory" in found["hides_memory"]["1"]


STEERS = {
    ".numba_config.yaml": "disable_jit: 1\nopt: banana\n",
    "sitecustomize.py": "import sys; sys.exit('steered')\n",
    "usercustomize.py": "import sys; sys.exit('steered')\n",
    "pyvenv.cfg": "home = /nowhere\n",
    "services.py": "import sys; sys.exit('steered')\n",
}
"""Files that would steer a process of ours that ran in their folder, or found it on its path."""


@pytest.mark.thorough
@pytest.mark.parametrize("command", ["check", "grade"])
def test_a_hand_ins_folder_steers_nothing_of_ours(lab: Lab, command: str):
    handin = write("functions", lab.folder)
    for name, text in STEERS.items():
        (handin / name).write_text(text, "utf-8")
    own = lab.file(GOAL_AHEAD, "own.toml")
    shutil.copy(own, handin / "rubric.toml")
    quad = handin / "quad.toml"
    quad.write_text(f"{quad.read_text('utf-8')}\n[dynamics]\nspeed = 0.001\n", "utf-8")
    more = ["--rubric", own, "--trust"] if command == "grade" else []
    done = lab.run(["env", "-C", str(handin), *lab.command("lab", command, ".", *more)])
    assert (done.code, "1 of 1 points" in done.out) == (0, True), done


FILLS = """
import os, time
while True:
    try:
        if os.fork() == 0:
            time.sleep(1000)
    except OSError:
        break
print("full", flush=True)
time.sleep(1000)
"""
STARTS = """
import threading
threads = [threading.Thread(target=threading.Event().wait, daemon=True) for _ in range(20)]
for each in threads:
    each.start()
print("started", flush=True)
"""


@pytest.mark.needs("sandbox")
def test_a_hand_in_with_all_its_processes_leaves_a_neighbour_his(lab: Lab):
    """The kernel counts the processes of a user: hand-ins that shared one took them from each other."""

    complete = machine.probe()

    def sandboxed(code: str) -> list[str]:
        folder, root = (Path(tempfile.mkdtemp(dir=lab.folder)) for _ in range(2))
        command, limits = [sys.executable, "-c", code], machine.Limits(processes=32)
        return complete.shut_in(command, folder, lab.home, root, limits)

    first = lab.spawn(*sandboxed(FILLS))
    try:
        # The kernel does not count root's: a machine without other users ends what has too many.
        eventually(lambda: first.log)
        assert first.log in {"full\n", "killed by its limit: 32 processes\n"}
        second = lab.run(sandboxed(STARTS), timeout=20)
        assert (second.out, second.err) == ("started\n", "")
    finally:
        first.end()  # by SIGKILL: SIGTERM does not end the first process of a namespace


def test_a_judge_that_fails_is_reported_as_that(lab: Lab, monkeypatch: pytest.MonkeyPatch):
    broken = lab.file("#!/bin/sh\nread job\necho 'no wings' >&2\nexit 3\n", "python")
    broken.chmod(0o700)
    row = {
        "name": "flies",
        "expect": "arrives",
        "rows": [{"at": 4.0, "do": "goto", "x": 1.0, "y": 1.0, "z": 1.0}],
    }
    monkeypatch.setattr(sys, "executable", str(broken))
    (found,) = grading.grade(
        [HandIn("completed", write("completed", lab.folder))], {"row": [row]}, machine.Limits(), jobs=1, machine=machine.Machine(),
        on_done=lambda _grade: None,
    )  # fmt: skip
    assert [each.output for each in found.tests] == ["not flown: its judge failed: no wings"]
