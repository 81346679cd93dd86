"""`lab new`, `lab check`, `lab grade` and `lab rubric check`."""

import base64
import html
import os
import time
from pathlib import Path
from typing import Annotated, Any

from quadctl.cli import output
from quadctl.cli.context import Options, require_local
from quadctl.cli.declarations import Arg, Option
from quadctl.services.runtime.errors import Invalid, QuadctlError, UsageError
from quadctl.services.runtime.files import making, write_new
from quadctl.services.runtime.params.load import read
from quadctl.services.runtime.params.names import nearest

_HERE = Path(__file__).parent
_VISIBLE, _HIDDEN = _HERE / "rubric.toml", _HERE / "hidden.toml"
_TEMPLATE = _HERE / "template"
_NEEDS = "`quadctl lab new DIR` writes one"
_HAND_INS = "give folders or zip files, e.g. `quadctl lab grade handins/*`"


def new(
    options: Options,
    folder: Annotated[Path, Arg("A new or empty folder.", "DIR")],
) -> None:
    """Write a student's folder: two nodes to complete, the visible rubric, tests, and LAB.md.

    Example: quadctl lab new mylab
    """
    # Sources of a student are no modules of ours.
    files = sorted(_TEMPLATE.iterdir())
    texts = {path.name.removesuffix(".txt"): path.read_text("utf-8") for path in files}
    texts["rubric.toml"] = _VISIBLE.read_text("utf-8")
    there = [name for name in texts if (folder / name).exists()]
    if there:
        raise Invalid(f"{folder / there[0]} already exists", "choose another folder")
    with making(folder):
        folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        write_new(folder / name, text)
    document = {"folder": str(folder), "files": sorted(texts)}
    output.either(
        options, document, f"wrote {', '.join(sorted(texts))} to {folder}; begin with LAB.md"
    )


def check(
    options: Options,
    folder: Annotated[Path, Arg("A folder of `lab new` (default: this one).", "DIR")] = Path(),
    report: Annotated[
        Path | None, Option("Folder of the report (default: DIR/report).", metavar="DIR")
    ] = None,
) -> None:
    """Fly the visible rubric against your nodes, and write a report with the flight's picture.

    Exits with 8 if a row does not hold.

    Example: quadctl lab check mylab
    """
    require_local(options, "lab check")
    from quadctl.cli.lab import formats
    from quadctl.cli.lab.handin import nodes_in
    from quadctl.cli.lab.judge import RowResult, fly
    from quadctl.cli.lab.machine import Limits
    from quadctl.cli.lab.rubric import rubric

    own = folder / "rubric.toml"
    file = own if own.exists() else _VISIBLE
    tables = read(file, _NEEDS)
    every = rubric(_with_hidden(tables), str(file))
    rows = every.visible()
    if not folder.is_dir():
        raise Invalid(f"there is no folder {folder}", _NEEDS)
    nodes = nodes_in(folder)
    target = report or folder / "report"
    with making(target):
        target.mkdir(parents=True, exist_ok=True)
    recording = target / "flight.mcap"
    recording.unlink(missing_ok=True)
    _compile_vehicle()
    began, results = time.monotonic(), list[RowResult]()
    until = began + Limits().wall
    for result in fly(
        folder.absolute(), nodes, rows, until=until, record=str(recording.absolute())
    ):
        results.append(result)
        if not options.json:
            output.line(f"{'ok  ' if result.ok else 'FAIL'}  {result.number}  {result.name}")
    place = {row.name: number for number, row in enumerate(rows.rows)}
    results.sort(key=lambda result: place[result.name])
    grade = formats.Grade(folder.absolute().name, results, time.monotonic() - began)
    picture = _picture(recording, target / "flight.png")
    page = target / "report.html"
    unseen = _unseen(every.points - rows.points)
    with making(page):
        page.write_text(_page(grade, unseen, picture), "utf-8")
    if options.json:
        output.document(grade.document())
    else:
        for line in (*formats.text(grade).splitlines(), *unseen):
            output.line(line)
        output.line(f"report: {page}")
    output.end(ok=grade.ok)


def grade(
    options: Options,
    submissions: Annotated[
        list[str] | None, Arg("Folders, zip or tar files; or a class's export.", "SUBMISSION...")
    ] = None,
    rubric: Annotated[
        Path | None, Option("Rubric, TOML (default: the built-in one).", metavar="FILE")
    ] = None,
    format: Annotated[  # noqa: A002 - the option's name
        str, Option("text, json, csv, gradescope, junit or github.")
    ] = "text",
    output_file: Annotated[
        Path | None, Option("Write to a file.", ("-o", "--output"), "FILE")
    ] = None,
    jobs: Annotated[
        int | None, Option("Hand-ins at a time (default: one for each processor).", min=1)
    ] = None,
    seconds: Annotated[float, Option("Limit for one node, s of a processor.")] = 60.0,
    wall: Annotated[
        float, Option("Last limit for one hand-in, s; beyond it, it is not graded.")
    ] = 1800.0,
    memory: Annotated[int, Option("Limit for one node, MB.", min=64)] = 1024,
    trust: Annotated[
        bool, Option("Grade also where this machine cannot shut hand-ins in completely.")
    ] = False,
) -> None:
    """Grade hand-ins: fly the rubric against the nodes of each, in a sandbox.

    A machine without namespaces cannot shut them in completely: there it asks for --trust.
    Exits with 0 when all have been graded, whatever their points.

    Example: quadctl lab grade handins/*.zip --format csv -o points.csv
    """
    require_local(options, "lab grade")
    from quadctl.cli.lab import exports, formats, grading, machine
    from quadctl.cli.lab.handin import HandIn

    if format not in formats.FORMS:
        hint = nearest(format, formats.FORMS) or f"one of {', '.join(formats.FORMS)}"
        raise UsageError(f"--format {format}: there is no such form", hint)
    if not submissions:
        raise UsageError("there is no hand-in to grade", _HAND_INS)
    paths = [Path(each) for each in submissions]
    for path in paths:
        if not path.exists():
            raise Invalid(f"there is no hand-in {path}", _HAND_INS)
    formats.require_fit(format, len(paths))
    handins = [HandIn(str(path), path) for path in paths]
    # Among others, a student's archive must not name other students.
    if len(paths) == 1 and not formats.is_of_one(format):
        handins = exports.handins_in(paths[0])
    tables = _tables(rubric) if rubric else _builtin()
    means = _means(trust=trust)
    _compile_vehicle()
    done = 0

    def on_done(graded: formats.Grade) -> None:
        nonlocal done
        done += 1
        points = f"{graded.score:g} of {graded.max_score:g}"
        output.note(f"{done}/{len(handins)}  {graded.submission}: {graded.fault or points}")

    grades = grading.grade(
        handins,
        tables,
        machine.Limits(seconds=seconds, wall=wall, memory=memory),
        jobs=jobs or os.cpu_count() or 1,
        machine=means,
        on_done=on_done,
    )
    if faults := sum(bool(graded.problem) for graded in grades):
        output.note(f"{faults} of {len(grades)} not gradable, see above")
    text = formats.written("json" if options.json and format == "text" else format, grades)
    if output_file is None:
        output.write(text)
        return
    with making(output_file):
        output_file.write_text(text, "utf-8", newline="")


def check_rubric(
    options: Options,
    rubric: Annotated[
        Path | None, Arg("Rubric, TOML (default: the built-in one).", "RUBRIC")
    ] = None,
    solutions: Annotated[
        list[str] | None, Arg("Right solutions, as hand-ins (default: ours).", "SOLUTION...")
    ] = None,
    only: Annotated[
        str,
        Option("Only mutants by this operator, or with this text in their names.", metavar="TEXT"),
    ] = "",
    jobs: Annotated[
        int | None, Option("Flights at a time (default: one for each processor).", min=1)
    ] = None,
    trust: Annotated[
        bool, Option("Fly also where this machine cannot shut hand-ins in completely.")
    ] = False,
) -> None:
    """Check a rubric: right solutions have full marks, and each mutant of them loses a row.

    A mutant is a right solution with one fault. Exits with 8 if a mutant passes, or a right solution
    loses a row.

    Example: quadctl lab rubric check rubric.toml
    """
    require_local(options, "lab rubric check")
    from quadctl.cli.lab import trial
    from quadctl.cli.lab.handin import HandIn

    tables = _tables(rubric) if rubric else _builtin()
    for path in map(Path, solutions or ()):
        if not path.exists():
            raise Invalid(
                f"there is no solution {path}", "give folders or archives, as for grading"
            )
    handins = [HandIn(path, Path(path)) for path in solutions or ()]
    with trial.right_solutions(handins) as right:
        planned = trial.plan(right, tables, only)
        means = _means(trust=trust)
        _compile_vehicle()
        flights = trial.Flights(tables, means, jobs or os.cpu_count() or 1)
        done = trial.fly(right, planned, flights, output.note)
    output.either(options, done.document(), done.text())
    output.end(ok=done.ok)


def _means(*, trust: bool) -> Any:
    """Return this machine's means to shut hand-ins in; raise QuadctlError if they have gaps, and none trusts."""
    from quadctl.cli.lab import machine

    means = machine.probe()
    if gaps := means.gaps():
        cannot = (
            f"this machine cannot shut hand-ins in completely ({means.lacks}): one could {gaps}"
        )
        if not trust:
            raise QuadctlError(
                cannot, "grade on one that can, or add --trust if you trust the hand-ins"
            )
        output.note(cannot)
    return means


def _compile_vehicle() -> None:
    """Compile the vehicle first: a run of seconds ends before, and each would begin anew."""
    from quadctl.services.dynamics import compiler

    if compiler.is_due():
        output.note("compiling the vehicle, once for this machine")
        compiler.have_made()


def _builtin() -> dict[str, Any]:
    return _with_hidden(read(_VISIBLE, _NEEDS))


def _with_hidden(tables: dict[str, Any]) -> dict[str, Any]:
    """Return a rubric's tables; for the built-in rubric with the rows that students do not see."""
    # A teacher grades a rubric of his own with rows of his own, which are not known here.
    if tables != read(_VISIBLE, _NEEDS) or not _HIDDEN.exists():
        return tables
    return {"row": [*tables["row"], *read(_HIDDEN, _NEEDS)["row"]]}


def _unseen(points: float) -> list[str]:
    """Return a line on the points that a check leaves out; none if it leaves none out."""
    if not points:
        return []
    many = "more point is" if points == 1 else "more points are"
    return [f"{points:g} {many} in rows that only `lab grade` flies"]


def _tables(file: Path) -> dict[str, Any]:
    """Return a rubric's tables; raise Invalid for a missing file or a bad rubric."""
    from quadctl.cli.lab.rubric import rubric

    tables = read(file, _NEEDS)
    rubric(tables, str(file))
    return tables


def _picture(recording: Path, target: Path) -> Path | None:
    """Draw the recorded flights; None if nothing was flown."""
    if not recording.exists():
        return None
    from quadctl.cli.plot.figure import draw
    from quadctl.cli.plot.plot import recorded

    try:
        draw(target, recorded(recording), "the flights of the rubric")
    except QuadctlError as problem:
        output.note(f"no picture: {problem.message}")
        return None
    return target


_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; padding: .4rem .6rem; border-bottom: 1px solid #ccc; vertical-align: top; }
.ok { color: #0a6b2d; } .fail { color: #b3261e; font-weight: bold; }
pre { white-space: pre-wrap; margin: 0; font-size: .85rem; } img { max-width: 100%; }
"""


def _page(grade: Any, unseen: list[str], picture: Path | None) -> str:
    rows = "\n".join(
        f"<tr><td>{html.escape(test.number)}</td><td>{html.escape(test.name)}</td>"
        f'<td class="{"ok" if test.ok else "fail"}">{"ok" if test.ok else "fails"}</td>'
        f"<td>{test.score:g} / {test.max_score:g}</td>"
        f"<td><pre>{html.escape(test.output)}</pre>{_hint(test.hint)}</td></tr>"
        for test in grade.tests
    )
    image = ""
    if picture is not None:
        data = base64.b64encode(picture.read_bytes()).decode()
        image = f'<h2>Flights</h2><img alt="The flights" src="data:image/png;base64,{data}">'
    note = "".join(f"<p>{html.escape(line)}</p>" for line in unseen)
    title = f"{html.escape(grade.submission)}: {grade.score:g} of {grade.max_score:g} points"
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        f"<style>{_STYLE}</style><h1>{title}</h1><table>"
        "<tr><th></th><th>Row</th><th></th><th>Points</th><th>Evidence</th></tr>"
        f"{rows}</table>{note}{image}</html>\n"
    )


def _hint(hint: str) -> str:
    return f"<p>Hint: {html.escape(hint)}</p>" if hint else ""
