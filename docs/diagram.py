"""Diagram and tables of the automaton for docs/explanation/safety.md; a test compares them with the page."""

import re

from quadctl.services.safety.automaton import RULES, Rule
from quadctl.services.safety.model import State


def diagram() -> str:
    """Return every change of state as a mermaid state diagram."""
    lines = ["stateDiagram-v2", f"    [*] --> {State.HOVERING.name}"]
    arrows: dict[tuple[State, State], list[str]] = {}
    for rule in RULES:
        if rule.at is not rule.to:
            arrows.setdefault((rule.at, rule.to), []).append(_cause(rule))
    for (at, to), causes in arrows.items():
        lines.append(f"    {at.name} --> {to.name} : {'<br>'.join(causes)}")
    return "\n".join(["```mermaid", *lines, "```"])


def table() -> str:
    """Return every row, in the order in which they are tried."""
    rows = ["| at | on | when | to | do |", "|---|---|---|---|---|"]
    for rule in RULES:
        to = rule.to.name if rule.to is not rule.at else ""
        cells = rule.at.name, rule.on.__name__, rule.when.__name__, to, rule.do.__name__
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


def words() -> str:
    """Return the first docstring line of each event, condition (without its verb) and action."""
    parts: list[tuple[str, str | None]] = []
    for rule in RULES:
        parts += [(part.__name__, part.__doc__) for part in (rule.on, rule.when, rule.do)]
    return "\n".join(
        f"- `{name}`: {_first_line(text or '')}"
        for name, text in sorted(dict(parts).items(), key=lambda part: part[0].lower())
    )


def _first_line(text: str) -> str:
    line = re.sub(r"^Return (whether,? )?", "", text.strip().partition("\n")[0])
    return line[:1].upper() + line[1:]


def _cause(rule: Rule) -> str:
    when = rule.when.__name__
    return rule.on.__name__ + ("" if when == "always" else f" [{when}]")
