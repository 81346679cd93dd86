"""Pages of grades: a student's report and feedback, and the page of a class. Pure.

A student chooses the name of a hand-in, and writes parts of its evidence: both are escaped.
"""

import base64
import html
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple
from urllib.parse import quote

from quadctl.cli.lab.formats import Grade, first_line, shown
from quadctl.cli.lab.judge import RowResult
from quadctl.services.runtime.terminal import escaped


class StudentLine(NamedTuple):
    """Line of the class page: a student's name, folder, and grade, None before the grading."""

    name: str
    folder: str
    grade: Grade | None


def feedback(name: str, grade: Grade) -> str:
    """Return the text for a student: points, and each row that fails with its evidence and hint.

    Hidden rows are without their evidence.
    """
    parts = [f"{name}: {_points(grade)} points"]
    if grade.problem:
        parts.append(grade.fault)
    elif grade.ok:
        parts.append("Every row holds.")
    else:
        parts += [_told(test) for test in grade.tests if not test.ok]
    return escaped("\n\n".join(parts)) + "\n"


def _told(test: RowResult) -> str:
    lines = [
        f"{test.number}  {test.name}: {test.score:g} of {test.max_score:g}",
        *shown(test).splitlines(),
    ]
    if test.hint:
        lines.append(f"hint: {test.hint}")
    return "\n    ".join(lines)


def student_page(
    name: str, grade: Grade, notes: Sequence[str], picture: bytes | None, files: Sequence[str]
) -> str:
    """Return the report of a hand-in: each row with its evidence and hint, the picture, links to files beside it."""
    title = f"{_safe(name)}: {_points(grade)} points"
    rows = "\n".join(
        f'<tr class="{"ok" if test.ok else "fails"}"><td class=number>{_safe(test.number)}</td>'
        f"<td class=name>{_safe(test.name)}{'' if test.visible else ' <small>(hidden)</small>'}</td>"
        f"<td class=mark>{'ok' if test.ok else 'fails'}</td>"
        f"<td class=points>{test.score:g} / {test.max_score:g}</td>"
        f"<td><pre>{_safe(test.output)}</pre>{_hint(test)}</td></tr>"
        for test in grade.tests
    )
    body = [f"<h1>{title}</h1>", _bar(grade.score, grade.max_score)]
    body += [f"<p class=problem>{_safe(grade.fault)}</p>"] if grade.problem else []
    # Without a flight each row has the same evidence.
    if not grade.problem or any(test.output != grade.problem for test in grade.tests):
        body.append(_table(("No.", "Row", "Mark", "Points", "Evidence"), rows))
    body += [f"<p>{_safe(note)}</p>" for note in notes]
    if picture is not None:
        data = base64.b64encode(picture).decode()
        body.append(f'<h2>Flights</h2><img alt="The flights" src="data:image/png;base64,{data}">')
    if files:
        links = ", ".join(_link(file, file) for file in files)
        body.append(f"<p>Beside this page: {links}</p>")
    return _page(title, body)


def class_page(entries: Sequence[StudentLine], seed: int) -> str:
    """Return the page of a class: the students with their points, and the rows, most failed first."""
    grades = [entry.grade for entry in entries if entry.grade]
    gradable = [grade for grade in grades if not grade.problem]
    title = f"{len(entries)} hand-in{'s' * (len(entries) != 1)}"
    facts = []
    if gradable:
        mean = sum(grade.score for grade in gradable) / len(gradable)
        facts.append(f"mean {mean:.3g} of {gradable[0].max_score:g} points")
    if bad := len(grades) - len(gradable):
        facts.append(f"{bad} not gradable")
    if due := len(entries) - len(grades):
        facts.append(f"{due} not graded yet")
    facts.append(f"seed: {seed}")
    students = "\n".join(
        f"<tr><td>{_link(f'{entry.folder}/report.html', entry.name) if entry.grade else _safe(entry.name)}</td>"
        f"<td class=points>{_points(entry.grade) if entry.grade else ''}</td><td>{_state(entry.grade)}</td></tr>"
        for entry in entries
    )
    rows = "\n".join(
        f"<tr><td class=number>{_safe(row.test.number)}</td><td class=name>{_safe(row.test.name)}</td>"
        f"<td class=points>{row.fails} of {len(gradable)}{_bar(row.fails, len(gradable))}</td>"
        f"<td>{_common(row)}</td></tr>"
        for row in failing(gradable)
    )
    body = [
        f"<h1>{title}</h1><p>{', '.join(facts)}</p><h2>Students</h2>",
        _table(("Student", "Points", "Rows that fail"), students),
        "<h2>Rows, most failed first</h2>",
        _table(("No.", "Row", "Fails", "Most common evidence"), rows),
    ]
    return _page(title, body)


class FailedRow(NamedTuple):
    """Row with the count of hand-ins that fail it, and the most common evidence with its count."""

    test: RowResult
    fails: int
    evidence: str
    times: int


def failing(grades: Iterable[Grade]) -> list[FailedRow]:
    """Return the rows, most failed first, then in the order of the rubric.

    Evidence that differs in its numbers alone is the same; the first one stands for it.
    """
    rows: dict[str, list[RowResult]] = {}
    for grade in grades:
        for test in grade.tests:
            rows.setdefault(test.name, []).append(test)
    found = []
    for tests in rows.values():
        failed = [first_line(test.output) for test in tests if not test.ok]
        kinds = Counter(map(_kind, failed))
        (kind, times), *_ = kinds.most_common(1) or [("", 0)]
        evidence = next((each for each in failed if _kind(each) == kind), "")
        found.append(FailedRow(tests[0], len(failed), evidence, times))
    return sorted(found, key=lambda row: -row.fails)


def _kind(evidence: str) -> str:
    return re.sub(r"\d+(?:\.\d+)?", "#", evidence)


def _common(row: FailedRow) -> str:
    if not row.fails:
        return ""
    count = f" <small>({row.times} of {row.fails})</small>" if row.fails > 1 else ""
    return f"{_safe(row.evidence)}{count}"


def _state(grade: Grade | None) -> str:
    if grade is None:
        return "not graded yet"
    if grade.problem:
        return f"<span class=problem>{_safe(grade.fault)}</span>"
    return _safe(", ".join(test.number for test in grade.tests if not test.ok)) or "every row holds"


def _points(grade: Grade) -> str:
    return f"{grade.score:g} of {grade.max_score:g}"


def _hint(test: RowResult) -> str:
    return f"<p>Hint: {_safe(test.hint)}</p>" if test.hint else ""


def _table(names: Iterable[str], rows: str) -> str:
    header = "".join(f"<th>{name}</th>" for name in names)
    return f"<table><thead><tr>{header}</tr></thead><tbody>{rows}</tbody></table>"


def _bar(part: float, whole: float) -> str:
    return f'<div class=bar><i style="width:{100 * part / whole:.0f}%"></i></div>' if whole else ""


def _link(path: str, text: str) -> str:
    return f'<a href="{html.escape(quote(path))}">{_safe(text)}</a>'


def _safe(text: str) -> str:
    return html.escape(escaped(text))


_STYLE = """
:root { color-scheme: light dark; --ok: light-dark(#0a6b2d, #56d364); --fails: light-dark(#b3261e, #ff7b72);
  --line: light-dark(#d0d7de, #3d444d); --soft: light-dark(#f6f8fa, #151b23); }
* { box-sizing: border-box; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 64rem; margin: 2rem auto; padding: 0 1rem; overflow-wrap: break-word; }
h1 { font-size: 1.6rem; line-height: 1.25; } h2 { font-size: 1.2rem; margin-top: 2rem; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; padding: .45rem .6rem; border-bottom: 1px solid var(--line); vertical-align: top; }
td { overflow-wrap: anywhere; } th, .number, .mark, .points, small { white-space: nowrap; } th { font-size: .85rem; } tbody tr:hover { background: var(--soft); }
.name { width: 35%; } .points { font-variant-numeric: tabular-nums; }
.mark { font-weight: bold; } .ok .mark { color: var(--ok); } .fails .mark, .problem { color: var(--fails); }
pre { white-space: pre-wrap; margin: 0; font-size: .85rem; } td p { margin: .3rem 0 0; }
img { max-width: 100%; background: #fff; } small { opacity: .75; }
.bar { height: .35rem; min-width: 5rem; margin: .3rem 0; border-radius: 1rem; background: var(--line); overflow: hidden; }
.bar i { display: block; height: 100%; background: #1f6feb; }
@media (max-width: 40rem) {
  thead { display: none; } tr, td { display: block; } tr { padding: .6rem 0; border-bottom: 1px solid var(--line); }
  td { border: 0; padding: .1rem 0; } .number, .name, .mark, .points { display: inline; padding-right: .6rem; }
}
"""


def _page(title: str, body: Iterable[str]) -> str:
    # Nothing is loaded, and no script runs, even if a text of a student got through.
    content = "\n".join(body)
    policy = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{_STYLE}</style></head>\n<body>\n{content}\n</body></html>\n"
    )
