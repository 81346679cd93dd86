"""The automaton as a drawing: its states, and the ways between them. Pure."""

from typing import get_args

from schemas.messages import StateName

STATES: tuple[str, ...] = get_args(StateName)

WAYS = {
    ("HOVERING", "VERIFYING"): "asked",
    ("VERIFYING", "MOVING"): "permitted",
    ("VERIFYING", "HOVERING"): "refused",
    ("MOVING", "VERIFYING"): "changed",
    ("HOVERING", "MOVING"): "went on",
    ("MOVING", "HOVERING"): "arrived, stopped, paused",
}
"""Every way that safety's table has between two states, and what it is taken for."""

_W, _H, _GAP, _TOP = 92, 34, 36, 44


def drawing() -> str:
    """An SVG in which the page lights the present state by its class, as `state-MOVING`."""
    width = len(STATES) * _W + (len(STATES) - 1) * _GAP + 2
    parts = [_way(*pair, text) for pair, text in WAYS.items()] + [_box(name) for name in STATES]
    return (
        f'<svg class="automaton" viewBox="0 0 {width} 118" role="img"'
        f' aria-label="The automaton: {", ".join(STATES)}">'
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="6"'
        ' markerHeight="6" orient="auto"><path d="M0 0 8 4 0 8z"/></marker></defs>'
        f"{''.join(parts)}</svg>"
    )


def _left(state: str) -> int:
    return 1 + STATES.index(state) * (_W + _GAP)


def _box(state: str) -> str:
    x = _left(state)
    return (
        f'<g class="state state-{state}"><rect x="{x}" y="{_TOP}" width="{_W}" height="{_H}"'
        f' rx="17"/><text x="{x + _W / 2:g}" y="{_TOP + 21}">{state}</text></g>'
    )


def _way(start: str, end: str, text: str) -> str:
    """Forwards above the middle, backwards below it; one that skips a state goes around it."""
    step = STATES.index(end) - STATES.index(start)
    if abs(step) == 1:
        y = _TOP + _H / 2 + (-6 if step > 0 else 6)
        x1 = _left(start) + (_W if step > 0 else 0)
        x2 = _left(end) + (0 if step > 0 else _W)
        line = f"M{x1} {y:g}H{x2}"
        words = (x1 + x2) / 2, (_TOP - 5 if step > 0 else _TOP + _H + 12)
        anchor = f'<text x="{words[0]:g}" y="{words[1]}">{text}</text>'
    elif step > 0:
        x1, x2 = _left(start) + _W // 2, _left(end) + _W // 2
        top = _TOP - 24
        line = f"M{x1:g} {_TOP}V{top + 8}q0 -8 8 -8H{x2 - 8:g}q8 0 8 8V{_TOP - 1}"
        anchor = f'<text x="{(x1 + x2) / 2:g}" y="{top - 5}">{text}</text>'
    else:
        x1, x2 = _left(start) + _W // 2, _left(end) + _W // 2
        y, bottom = _TOP + _H, _TOP + _H + 24
        line = f"M{x1:g} {y}V{bottom - 8}q0 8 -8 8H{x2 + 8:g}q-8 0 -8 -8V{y + 1}"
        anchor = f'<text x="{(x1 + x2) / 2:g}" y="{bottom + 12}">{text}</text>'
    return f'<g class="way"><path d="{line}" marker-end="url(#tip)"/>{anchor}</g>'
