"""Hand-ins for the lab's tests: good ones, typical mistakes, and cheats, as folders.

    python -m tests.support.handins FOLDER

It writes the good ones and the mistakes, a class to try `lab grade` on, and prints each one's points.
"""

import sys
import tomllib
from pathlib import Path
from typing import NamedTuple

from quadctl.cli.lab import grading
from tests.support.lab import Lab

SOURCES = Path(__file__).parents[1] / "lab" / "handins"
SOLUTIONS = Path(grading.__file__).parent / "solutions"

GOOD = ("completed", "functions", "table")
"""Three that hold in every row, written differently."""
STYLES = (
    "sleeps", "listener", "ticks", "thread", "closures", "verifies_in_loop", "slow_ticks",
    "minimal", "states", "own_loop", "beyond",
)  # fmt: skip
"""More, by students who had read the kit and its pages alone."""


class Mistake(NamedTuple):
    """A change of the completed hand-in, and the rows of the built-in rubric that it costs."""

    node: str
    old: str
    new: str
    rows: frozenset[str]


def _costs(*rows: str) -> frozenset[str]:
    return frozenset(rows)


MISTAKES = {
    "no_verifying": Mistake(
        "safety", '        self.state = "VERIFYING"\n        self.publish()\n', "",
        _costs("1.1", "2.1", "2.5", "2.6", "2.7", "2.8", "2.9", "2.10", "2.12", "4.2"),
    ),
    "forgets_z": Mistake(
        "safety", " and point.z <= cage.z", "", _costs("1.1", "2.9", "5.1")
    ),
    "accepts_the_far_side": Mistake(
        "safety", "abs(point.x) <= cage.x and abs(point.y)", "point.x <= cage.x and point.y",
        _costs("1.1", "2.6", "2.8", "5.1"),
    ),
    "never_arrives": Mistake(
        "safety", "Setpoint(pose.boot, pose.seq, self.goal,", "Setpoint(pose.boot, pose.seq, self.home,",
        _costs(
            "1.1", "1.2", "2.1", "2.2", "2.3", "2.4", "2.5", "2.6", "2.7", "2.8", "2.9", "2.10",
            "2.11", "2.12", "4.1", "4.2", "4.3", "4.4", "4.5", "5.1",
        ),
    ),
    "toggles_without_effect": Mistake(
        "safety", "(self.cage_on and not self.is_inside(goal))", "not self.is_inside(goal)",
        _costs("4.1", "4.2", "4.3", "4.4", "4.5", "5.1"),
    ),
    "no_baseline": Mistake("pressure", "raw - self.baseline", "raw", _costs("3.2", "3.3")),
    "baseline_in_pascals": Mistake(
        "pressure", "sum(self.last) / len(self.last)", "100 * sum(self.last) / len(self.last)",
        _costs("3.1", "3.2", "3.3", "3.4", "3.5"),
    ),
    "mean_of_two_seconds": Mistake("pressure", "maxlen=10", "maxlen=20", _costs("3.1")),
    "drops_requests_in_flight": Mistake(
        "safety", '"busy: flying to another goal"', '""', _costs("2.11")
    ),
    "hard_coded_parameters": Mistake(
        "safety", "CageSize(size.x, size.y, size.z)", "CageSize(5.0, 5.0, 5.0)", _costs("1.1")
    ),
    "never_stops": Mistake(
        "safety", 'self.cage_on and self.state == "MOVING" and not', "False and not",
        _costs("4.3", "4.4"),
    ),
    "never_releases_the_brake": Mistake(
        "safety", '"MOVING", goal, False', '"MOVING", goal, self.brake', _costs("4.4")
    ),
    "hard_coded_range": Mistake(
        "safety", "params.safety.acceptance_range", "0.5", _costs("1.2")
    ),
    "forgets_the_floor": Mistake("safety", "goal.z < 0 or ", "", _costs("2.10", "2.12")),
    "ignores_unset": Mistake("pressure", " if request.zero else 0.0", "", _costs("3.3")),
}  # fmt: skip

CHEATS = (
    "prints_a_forged_report", "kills_the_grader", "sleeps_for_ever", "forks_without_end",
    "fills_the_disk", "reads_the_rubric", "publishes_poses_of_its_own", "answers_for_another_node",
    "exits_at_once", "floods_the_bus", "forges_poses", "sets_the_vehicles_fault", "floods_states",
    "hides_memory",
)  # fmt: skip


def write(name: str, folder: Path) -> Path:
    """Write a hand-in by its name to a new folder, and return the folder."""
    target = folder / name
    target.mkdir()
    texts = _texts(SOLUTIONS / (name if (SOLUTIONS / name).exists() else "completed"))
    safety = "python my_safety.py"
    if (style := SOURCES / "styles" / name).exists():
        texts |= _texts(style)
    elif name == "table":
        texts["my_safety.py"] = (SOURCES / "table.py").read_text("utf-8")
    elif name in CHEATS:
        safety = f"python cheat.py {name}"
        texts |= {"cheat.py": (SOURCES / "cheat.py").read_text("utf-8")}
        del texts["my_safety.py"]
    if mistake := MISTAKES.get(name):
        file = f"my_{mistake.node}.py"
        assert mistake.old in texts[file], f"{name}: the completed hand-in has changed"
        texts[file] = texts[file].replace(mistake.old, mistake.new)
    texts.setdefault(
        "quad.toml", f'[processes]\nsafety = "{safety}"\npressure = "python my_pressure.py"\n'
    )
    for own, text in texts.items():
        (target / own).write_text(text, "utf-8")
    return target


def _texts(folder: Path) -> dict[str, str]:
    """Return the texts of a folder's files; those of the package have .txt after their names."""
    return {file.name.removesuffix(".txt"): file.read_text("utf-8") for file in folder.iterdir()}


ROWS = [
    "1.1", "1.2", "2.1", "2.2", "2.3", "2.4", "2.5", "2.6", "2.7", "2.8", "2.9", "2.10", "2.11",
    "2.12", "2.13", "3.1", "3.2", "3.3", "3.4", "3.5", "4.1", "4.2", "4.3", "4.4", "4.5", "4.6",
]  # fmt: skip
"""Numbers of the visible rows."""
ARRIVES = (
    '[[row]]\nname = "flies"\nexpect = "arrives"\nend = 9.0\n'
    'rows = [{ at = 4.0, do = "goto", x = 1.0, y = 1.0, z = 1.0 }]\n'
)
"""Rubric with one row, for a goal at 4 s."""
GOAL_AHEAD = """
[[row]]
name = "flies"
expect = "arrives"
end = 9.0
rows = [{ at = 4.0, do = "goto", x = 1.0, y = 0.0, z = 1.0 }]
"""
"""Rubric with one row, for a goal 1 m ahead."""


def graded(lab: Lab, *words: object, timeout: float = 60.0) -> dict[str, dict[str, str]]:
    """Grade hand-ins with known hidden flights; return the output of each row that does not hold, by hand-in and number.

    Marks are the same on a machine that cannot shut them in completely.
    """
    done = lab.quadctl(
        "lab", "grade", *words, "--format", "json", "--trust", "--seed", 19, timeout=timeout
    )
    assert done.code == 0, done.err
    return {
        Path(each["submission"]).stem: {
            test["number"]: test["output"] for test in each["tests"] if not test["ok"]
        }
        for each in done.json
    }


def promised() -> dict[str, float]:
    """Return the points that the built-in rubric has for each good hand-in and each mistake."""
    texts = [Path(grading.__file__).with_name(name) for name in ("rubric.toml", "hidden.toml")]
    rows = [row for text in texts for row in tomllib.loads(text.read_text("utf-8"))["row"]]
    points = {row["number"]: row.get("points", 1.0) for row in rows}
    lost = dict.fromkeys(GOOD, _costs()) | {name: each.rows for name, each in MISTAKES.items()}
    return {
        name: sum(points.values()) - sum(points[row] for row in rows) for name, rows in lost.items()
    }


if __name__ == "__main__":
    target = Path(sys.argv[1])
    target.mkdir()
    for name, points in promised().items():
        write(name, target)
        print(f"{target / name}: {points:g}")
