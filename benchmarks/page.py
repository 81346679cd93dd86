"""The console's page: time until it shows the vehicle, and its cost."""

import json
import subprocess
import time

from benchmarks import proc
from benchmarks.children import Failed
from benchmarks.effort import Effort
from benchmarks.results import Results
from benchmarks.system import QUADCTL, running
from tests.support import abilities
from tests.support.browser import Browser, Tab, browser

_LIVE = "document.body?.dataset.link === 'live'"
_SETTLED = 3.0
"""Time (s) in which a page is fully drawn."""


def measure(results: Results, effort: Effort) -> None:
    """Measure the time until a page shows the vehicle; then one page at 10 Hz in hover."""
    if abilities.browser() is None:
        raise Failed(abilities.ABILITIES["browser"].remedy)
    with running() as where, browser() as shown:
        words = [QUADCTL, "console", "--port", "0", "--json"]
        console = subprocess.Popen(words, env=where.environment, stdout=subprocess.PIPE, text=True)
        try:
            assert console.stdout is not None
            url = json.loads(console.stdout.readline())["url"]
            page = _opened(shown, url)  # the first: nothing is in the browser's cache
            for _ in range(effort.launches):
                page.close()
                began = time.perf_counter()
                page = _opened(shown, url)
                results.add("page", "ours", [time.perf_counter() - began])
            time.sleep(_SETTLED)
            busy, began = proc.busy(console.pid), time.monotonic()
            time.sleep(effort.seconds)
            share = (proc.busy(console.pid) - busy) / (time.monotonic() - began)
            results.add("console_processor", "ours", [100 * share])
            results.add("console_memory", "ours", [proc.pss(console.pid)])
        finally:
            console.kill()
            console.wait()


def _opened(shown: Browser, url: str) -> Tab:
    page = shown.tab(url)
    page.until(_LIVE, 60)
    return page
