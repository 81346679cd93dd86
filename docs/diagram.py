"""Picture and tables of the automaton for docs/explanation/safety.md; a test compares them with the page."""

import re
import textwrap

from quadctl.services.safety.automaton import RULES, Rule, keep
from quadctl.services.safety.model import State
from quadctl.services.safety.motion import LIMITS

_WIDTH, _HEIGHT, _MIDDLE, _LINE = 790, 285, 115, 17
"""Size of the picture, height of the boxes' middle, and distance of two lines of text, px."""
_LEFT = {State.HOVERING: 40, State.VERIFYING: 360, State.MOVING: 660}
"""Left edge of each state's box, px."""
_PATHS = {
    (State.HOVERING, State.VERIFYING): ("M150 105H360", 255, 97, 26),
    (State.VERIFYING, State.HOVERING): ("M360 125H150", 255, 142, 26),
    (State.VERIFYING, State.MOVING): ("M470 105H660", 565, 97, 20),
    (State.MOVING, State.VERIFYING): ("M660 125H470", 565, 142, 20),
    (State.HOVERING, State.MOVING): ("M95 85C95 10 715 10 715 85", 405, 20, 60),
    (State.MOVING, State.HOVERING): ("M715 145C715 250 95 250 95 145", 405, 241, 84),
}
"""Of each change of state: its arrow's path, and the place (px) and columns of its causes."""


def diagram() -> str:
    """Return every change of state as an SVG picture, which a page shows without a network."""
    arrows: dict[tuple[State, State], list[str]] = {}
    for rule in RULES:
        if rule.at is not rule.to:
            arrows.setdefault((rule.at, rule.to), []).append(_cause(rule))
    size = f'viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" height="{_HEIGHT}"'
    tip = 'viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto"'
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="13">',
        f'<defs><marker id="tip" {tip}><path d="M0 0 8 4 0 8z" fill="#555"/></marker></defs>',
        # A page may be dark: the picture brings the paper for its black words.
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="#fff"/>',
        f'<circle cx="12" cy="{_MIDDLE}" r="6"/>{_arrow(f"M18 {_MIDDLE}H40")}',
        *(_box(state, left) for state, left in _LEFT.items()),
        *(_change(pair, causes) for pair, causes in arrows.items()),
        "</svg>\n",
    ])  # fmt: skip


def _box(state: State, left: int) -> str:
    return (
        f'<rect x="{left}" y="85" width="110" height="60" rx="10" fill="#eef3fb" stroke="#555"/>'
        f'<text x="{left + 55}" y="{_MIDDLE + 5}" text-anchor="middle">{state.name}</text>'
    )


def _change(pair: tuple[State, State], causes: list[str]) -> str:
    """Return the arrow of a change, and its causes: above a line to the right, else below it."""
    path, x, y, columns = _PATHS[pair]
    # textwrap breaks no line at this space: an event and its condition stay together.
    lines = textwrap.wrap(", ".join(causes).replace(" [", "\N{NO-BREAK SPACE}["), columns)
    name = f"{pair[0].name} to {pair[1].name}"
    to_the_right = _LEFT[pair[0]] < _LEFT[pair[1]]
    first = y - _LINE * (len(lines) - 1) if to_the_right else y
    return f"<g><title>{name}: {', '.join(causes)}</title>{_arrow(path)}" + "".join(
        f'<text x="{x}" y="{first + _LINE * n}" text-anchor="middle">{line}</text>'
        for n, line in enumerate(lines)
    ) + "</g>"  # fmt: skip


def _arrow(path: str) -> str:
    return f'<path d="{path}" fill="none" stroke="#555" marker-end="url(#tip)"/>'


def table() -> str:
    """Return every row that changes something, in the order in which they are tried."""
    rows = ["| at | on | when | to | do |", "|---|---|---|---|---|"]
    for rule in RULES:
        if rule.do is keep:
            continue
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


def limits() -> str:
    """Return the first docstring line of each limit on goals, in their order."""
    lines = [f"- `{limit.__name__}`: {_first_line(limit.__doc__ or '')}" for limit in LIMITS]
    return "\n".join(["Limits on a goal, in their order; then its way is checked:", "", *lines])


def _first_line(text: str) -> str:
    line = re.sub(r"^Return (whether,? )?", "", text.strip().partition("\n")[0])
    return line[:1].upper() + line[1:]


def _cause(rule: Rule) -> str:
    when = rule.when.__name__
    return rule.on.__name__ + ("" if when == "always" else f" [{when}]")
