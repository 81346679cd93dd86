"""The console's page: time until it shows the vehicle, and its cost."""

import json
import subprocess
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

from benchmarks import many, proc
from benchmarks.children import Failed
from benchmarks.effort import Effort
from benchmarks.results import Results
from benchmarks.system import QUADCTL, Home, running
from tests.support import abilities
from tests.support.browser import Browser, Tab, browser

_LIVE = "document.body?.dataset.link === 'live'"
_SETTLED = 3.0
"""Time (s) in which a page is fully drawn."""


def measure(results: Results, effort: Effort) -> None:
    """Measure the time until a page shows the vehicle; then one page at 10 Hz in hover."""
    if abilities.browser() is None:
        raise Failed(abilities.ABILITIES["browser"].remedy)
    with running() as where, browser() as shown, _console(where) as (url, pid):
        page = _opened(shown, url)  # the first: nothing is in the browser's cache
        for _ in range(effort.launches):
            page.close()
            began = time.perf_counter()
            page = _opened(shown, url)
            results.add("page", "ours", [time.perf_counter() - began])
        time.sleep(_SETTLED)
        busy, began = proc.busy(pid), time.monotonic()
        time.sleep(effort.seconds)
        share = (proc.busy(pid) - busy) / (time.monotonic() - began)
        results.add("console_processor", "ours", [100 * share])
        results.add("console_memory", "ours", [proc.pss(pid)])
    _measure_most(results, effort)


def _measure_most(results: Results, effort: Effort) -> None:
    """Measure the time until a page shows one of a thousand vehicles, a quarter of them in flight."""
    with (
        many.most() as (where, session),
        browser() as shown,
        _console(where) as (url, _),
        ThreadPoolExecutor(1) as pool,
    ):
        flight = pool.submit(many.fly_part, where, session, effort.seconds + 10)
        page = _opened(shown, f"{url}?vehicle={many.SHOWN}")
        for _ in range(3):
            page.close()
            began = time.perf_counter()
            page = _opened(shown, f"{url}?vehicle={many.SHOWN}")
            results.add("page_1000", "ours", [time.perf_counter() - began])
        flight.result()
        if again := {name for name, node in where.nodes().items() if node["restarts"]}:
            raise Failed(f"with a page of 1000 vehicles, {', '.join(again)} was started again")


@contextmanager
def _console(where: Home) -> Iterator[tuple[str, int]]:
    """Start a console; yield its address and its pid."""
    words = [QUADCTL, "console", "--port", "0", "--json"]
    console = subprocess.Popen(words, env=where.environment, stdout=subprocess.PIPE, text=True)
    try:
        assert console.stdout is not None
        yield json.loads(console.stdout.readline())["url"], console.pid
    finally:
        console.kill()
        console.wait()


def _opened(shown: Browser, url: str) -> Tab:
    page = shown.tab(url)
    page.until(_LIVE, 60)
    return page
