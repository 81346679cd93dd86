"""Report of a campaign: one HTML file that needs nothing else, on a screen or printed."""

import platform
import sqlite3
from collections import Counter
from collections.abc import Callable
from decimal import ROUND_CEILING, Context
from html import escape
from importlib import metadata
from math import log1p
from pathlib import Path
from string import Template
from typing import Any

import msgspec

from quadctl.services.campaign import pictures
from quadctl.services.campaign.breakdown import (
    COLUMNS,
    CONFIDENCE,
    Breakdown,
    out_of_reach,
    upper_bound,
)
from quadctl.services.campaign.score import seeds
from quadctl.services.campaign.track import FlightTrack
from quadctl.services.runtime.files import write_whole
from quadctl.services.safety.automaton import RULES, Rule
from quadctl.services.safety.model import State

_WORST = 10
"""Flights with a picture."""


def write(
    path: Path,
    connection: sqlite3.Connection,
    figures: dict[str, Any],
    command: str,
    again: Callable[[int], str],
    track: Callable[[int], FlightTrack],
) -> None:
    """Write the page, whole or not at all; raise Invalid if it cannot be written.

    `connection` is the campaign's database, `figures` its document (score.py). `command` flies all
    flights again; `again` returns the command for one seed, and `track` the track of its flight.
    """
    within = seeds(figures["seed"], figures["flights"])
    ends = {"first": within[0], "last": within[-1]}
    breakdown = Breakdown(
        connection.execute(
            f"SELECT {COLUMNS} FROM flights WHERE seed BETWEEN :first AND :last",  # noqa: S608 - a constant
            ends,
        )
    )
    conditions = msgspec.json.decode(
        connection.execute("SELECT conditions FROM campaign").fetchone()[0]
    )
    worst = connection.execute(
        "SELECT seed, worst_excursion, at, wind, faults, violations FROM flights"
        " WHERE seed BETWEEN :first AND :last"
        " ORDER BY violations != '[]' DESC, worst_excursion DESC, seed LIMIT :most",
        ends | {"most": _WORST},
    ).fetchall()
    tracks = {row[0]: track(row[0]) for row in worst}
    margins = {each.margin for each in tracks.values()}
    fired, matrix, reasons = _rules(breakdown)
    page = Template(Path(__file__).with_suffix(".html").read_text(encoding="utf-8")).substitute(
        title=f"{_count(figures['flights'])} flights, seed {figures['seed']}",
        verdict=_verdict(len(figures["violations"])),
        tiles=_tiles(figures, conditions["seconds"]),
        violations=_violations(figures["violations"], again),
        conditions=_conditions(conditions, command, figures["hash"]),
        histogram=pictures.histogram(
            breakdown.excursions, margins.pop() if len(margins) == 1 else None
        ),
        fired=fired,
        matrix=matrix,
        reasons=reasons,
        tables=_tables(figures),
        flights="".join(_flight(row, tracks[row[0]], again(row[0])) for row in worst),
    )
    write_whole(path, page.encode())


def _verdict(broken: int) -> str:
    if not broken:
        return '<span class="verdict">no promise was broken</span>'
    flights = "1 flight" if broken == 1 else f"{_count(broken)} flights"
    return f'<span class="verdict broken">{flights} broke a promise</span>'


def _tiles(figures: dict[str, Any], seconds: float) -> str:
    flights, broken, worst = figures["flights"], len(figures["violations"]), figures["worst"]
    bound = upper_bound(broken, flights)
    # Rounded up, as it is a bound.
    percent = Context(3, ROUND_CEILING).create_decimal_from_float(100 * bound)
    tiles = (
        ("flights", _count(flights), f"of {seconds:g} s each"),
        ("simulated", f"{flights * seconds / 3600:,.1f} h".replace(",", "\u202f"), "of flight"),
        (
            "worst excursion", _metres(figures["worst_excursion"]),
            f"beyond the cage: seed {worst['seed']}, at {worst['at']:.2f} s",
        ),
        ("flights with a violation", _count(broken), "of a promise"),
        (
            "probability of a violation", f"≤ {percent:f} %",
            f"at {100 * CONFIDENCE:g} % confidence: at most 1 in {_count(int(1 / bound))} flights",
        ),
    )  # fmt: skip
    return "".join(
        f'<div class="tile"><small>{name}</small><b>{value}</b><small>{more}</small></div>'
        for name, value, more in tiles
    )


def _violations(violations: list[dict[str, Any]], again: Callable[[int], str]) -> str:
    """Return a section with each violation, the number of its flights, and the first of them."""
    if not violations:
        return ""
    counts = Counter(text for each in violations for text in each["what"])
    first = {text: each["seed"] for each in reversed(violations) for text in each["what"]}
    rows = "".join(
        f'<tr><td class="violation">{escape(text)}</td><td class="number">{_count(count)}</td>'
        f"<td><code>{escape(again(first[text]))}</code></td></tr>"
        for text, count in counts.most_common()
    )
    heads = '<tr><th>promise</th><th class="number">flights</th><th>fly the first again</th></tr>'
    return f'<section><h2>Violations</h2><div class="wide"><table>{heads}{rows}</table></div></section>'


def _conditions(conditions: dict[str, Any], command: str, digest: str) -> str:
    names = {"seconds": "seconds of a flight", "wind": "mean wind, m/s"}
    items = {names.get(name, name): escape(_plain(value)) for name, value in conditions.items()}
    items["versions"] = ", ".join(
        [f"Python {platform.python_version()}", *map(_version, ("quadctl", "numpy", "numba"))]
    )
    items["machine"] = escape(f"{platform.system()} {platform.release()}, {platform.machine()}")
    items["fly it again"] = f"<code>{escape(command)}</code>"
    items["SHA-256"] = f"<code>{digest}</code>"
    return "".join(f"<dt>{escape(name)}</dt><dd>{value}</dd>" for name, value in items.items())


def _version(package: str) -> str:
    try:
        return f"{package} {metadata.version(package)}"
    except metadata.PackageNotFoundError:
        return f"no {package}"


def _plain(value: Any) -> str:
    match value:
        case bool():
            return "yes" if value else "no"
        case dict():
            return ", ".join(f"{name}={_plain(each)}" for name, each in value.items()) or "none"
        case list():
            return ", ".join(map(_plain, value)) or "none"
        case float():
            return f"{value:g}"
    return str(value)


def _rules(breakdown: Breakdown) -> tuple[str, str, str]:
    """Return a sentence on the rules that never fired, the matrix, and why some cannot."""
    never = [rule for rule in RULES if not breakdown.fired["all"][str(rule)]]
    barred = {str(rule): reason for rule in never if (reason := out_of_reach(rule))}
    reasons = list(dict.fromkeys(barred.values()))
    heads = "".join(
        f'<th class="number">{escape(name)}<small>{_count(breakdown.flights[name])} flights</small></th>'
        for name in breakdown.fired
    )
    matrix = (
        f"<thead><tr><th>event</th><th>condition</th><th>to</th><th>action</th>{heads}</tr></thead>"
    )
    for state in State:
        matrix += (
            f'<tr class="state"><td colspan="{4 + len(breakdown.fired)}">{state.name}</td></tr>'
        )
        for rule in RULES:
            if rule.at is state:
                number = 1 + reasons.index(barred[str(rule)]) if str(rule) in barred else 0
                matrix += _rule(rule, breakdown, number)
    sentence = (
        f"Never fired: <b>{len(never) - len(barred)} of {len(RULES)}</b> rules, and {len(barred)} more"
        " that cannot fire in a campaign, for the reasons below the table."
    )
    listed = "".join(f"<li>{reason}</li>" for reason in reasons)
    return sentence, matrix, f'<ol class="why">{listed}</ol>'


def _rule(rule: Rule, breakdown: Breakdown, reason: int) -> str:
    """Return the row of a rule; `reason` numbers the reason why it cannot fire, 0 if it can."""
    to = "" if rule.to is rule.at else f"→ {rule.to.name}"
    words = (rule.on.__name__, rule.when.__name__, to, rule.do.__name__)
    head = "".join(f"<td>{word}</td>" for word in words)
    counts = [fired[str(rule)] for fired in breakdown.fired.values()]
    if any(counts):
        most = max(breakdown.fired["all"].values())
        return f"<tr>{head}{''.join(_cell(count, most) for count in counts)}</tr>"
    kind, note = ("beyond", f"cannot fire ({reason})") if reason else ("never", "never fired")
    rest = f'<td colspan="{len(counts) - 1}"></td>'
    return f'<tr class="{kind}">{head}<td class="number">{note}</td>{rest}</tr>'


def _cell(count: int, most: int) -> str:
    # As the counts span many powers of ten, the shade follows their logarithm.
    shade = f' style="--part: {0.7 * log1p(count) / log1p(most):.2f}"' if count else ""
    return f'<td class="number heat"{shade}>{_count(count) if count else "·"}</td>'


def _tables(figures: dict[str, Any]) -> str:
    arrivals = figures["arrivals"]
    names = {"median": "median", "p90": "90 %", "p99": "99 %", "most": "longest"}
    times = {name: f"{arrivals[part]:.2f} s" for part, name in names.items() if part in arrivals}
    kinds = ("refusals", "stops", "transitions")
    counted = {kind: {name: _count(n) for name, n in figures[kind].items()} for kind in kinds}
    title = f"time to arrive, of {_count(arrivals['count'])} arrivals"
    return "".join(_table(*each) for each in (counted | {title: times}).items())


def _table(title: str, rows: dict[str, str]) -> str:
    body = "".join(
        f'<tr><td>{escape(name)}</td><td class="number">{value}</td></tr>'
        for name, value in rows.items()
    )
    return f"<table><caption>{title}</caption>{body or '<tr><td>none</td></tr>'}</table>"


def _flight(row: tuple[int, float, float, str, str, str], track: FlightTrack, again: str) -> str:
    seed, excursion, at, wind, faults, violations = row
    east, north = msgspec.json.decode(wind)
    about = [f"{_metres(excursion)} at {at:.2f} s" if excursion else "never beyond the cage"]
    if east or north:
        about.append(f"wind ({east:g}, {north:g}) m/s")
    about += [f"{count} {kind}" for kind, count in msgspec.json.decode(faults).items()]
    texts = "".join(
        f'<div class="violation">{escape(text)}</div>' for text in msgspec.json.decode(violations)
    )
    picture = pictures.flight(track, at if excursion else None, str(seed))
    return (
        f"<figure><h3>seed {seed}</h3><figcaption>{escape(', '.join(about))}</figcaption>{texts}"
        f"<code>{escape(again)}</code>{picture}</figure>"
    )


def _count(number: int) -> str:
    return f"{number:,}".replace(",", "\u202f")


def _metres(length: float) -> str:
    if length == 0:
        return "0"
    unit, size = next(each for each in _UNITS if length >= each[1] or each is _UNITS[-1])
    return f"{float(f'{length / size:.3g}'):g} {unit}"


_UNITS = (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6))
