"""A campaign's report in words."""

from collections.abc import Iterator
from typing import Any


def lines(report: dict[str, Any], order: dict[str, Any]) -> Iterator[str]:
    """The report of an order, a line at a time."""
    yield from report.get("log", ())
    worst = report["worst"]
    yield (
        f"{report['flights']} flights of {order['seconds']:g} s, worst excursion beyond the cage "
        f"{report['worst_excursion']:.2g} m (seed {worst['seed']}, at {worst['at']:.2f} s)"
    )
    for name in ("transitions", "refusals", "stops"):
        for what, count in report[name].items():
            yield f"{name:12} {count:8}  {what}"
    arrivals = report["arrivals"]
    if arrivals["count"]:
        parts = ("median", "p90", "p99", "most")
        yield f"{'arrivals':12} {arrivals['count']:8}  in " + ", ".join(
            f"{arrivals[part]:.2f} s ({part})" for part in parts
        )
    more = (" --faults" if order["faults"] else "") + (
        f" --wind {order['wind']:g}" if order["wind"] else ""
    )
    for violation in report["violations"]:
        yield f"VIOLATION    seed {violation['seed']}: {'; '.join(violation['what'])}"
        yield f"  again: quadctl campaign --replay {violation['seed']} --seconds {order['seconds']:g}{more}"
    yield f"SHA-256      {report['hash']}"
