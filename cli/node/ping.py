"""`node ping`: round trips through the executor of a node."""

import contextlib
import time
from functools import partial
from typing import Annotated

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg, Option
from quadctl.cli.node.lookup import answering, params_of, run_of, see
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.concurrent import Answers, ask_each
from quadctl.services.runtime.errors import Invalid, QuadctlError, Unreachable, UsageError
from quadctl.services.runtime.run_files import ProcessRecord

_LONGEST_INTERVAL = 3600.0


def ping(
    options: Options,
    name: Annotated[str | None, Arg("A node.", complete="node")] = None,
    count: Annotated[int, Option("Number of pings.", ("-n", "-c"), min=1)] = 4,
    interval: Annotated[float, Option("Seconds between pings.")] = 1.0,
    every: Annotated[bool, Option("Ping all nodes.", ("--all", "-a"))] = False,
) -> None:
    """Call a node several times, and print how long each answer took.

    The exit code is 3 if a node is away, 4 if it is frozen.

    Example: quadctl node ping safety -n 4
    """
    if every == (name is not None):
        raise UsageError("node ping takes a node's name or --all")
    if not 0 <= interval <= _LONGEST_INTERVAL:
        raise UsageError(
            f"--interval {interval:g}: not a time", f"give seconds, up to {_LONGEST_INTERVAL:g}"
        )
    # The first pings' time includes connecting and looking around.
    ends = time.monotonic() + options.timeout
    if name is not None:
        options, name = context.about_node(options, name)
    run = run_of(options)
    with context.connect(options) as client:
        seen = see(client, run)
        context.check_vehicle(options, seen.live)
        processes = answering(seen) if name is None else [seen.find(name)]
        for process in processes:
            if process.name in seen.live and not seen.answers(process.name):
                raise Unreachable(
                    f"{process.name} serves no get_params, which a ping calls",
                    f"`quadctl node info {process.name}` shows its process",
                )
        by_name = {process.name: process for process in processes}
        _Pings(options, client).run(by_name, count, interval, ends)


class _Pings:
    """Pings of several nodes in parallel; a node that fails once is not called again."""

    def __init__(self, options: Options, client: Client) -> None:
        self._options, self._client = options, client
        self._took: dict[str, list[float]] = {}
        self._problems: dict[str, QuadctlError] = {}

    def run(
        self, processes: dict[str, ProcessRecord], count: int, interval: float, ends: float
    ) -> None:
        """Ping, print and sum up; raise the first problem. `ends` (monotonic s): for round one."""
        begun = time.monotonic()
        for number in range(count):
            time.sleep(max(begun + number * interval - time.monotonic(), 0))
            until = time.monotonic() + self._client.timeout if number else ends
            names = [name for name in processes if name not in self._problems]
            results = ask_each(names, partial(self._once, processes, until))
            self._problems |= results.problems
            for name, took in results.answers.items():
                self._took.setdefault(name, []).append(took)
                document = {"node": name, "ms": took * 1000}
                output.either(self._options, document, f"pong from {name}: {took * 1000:.2f} ms")
            if len(self._problems) == len(processes):
                break
        for name, all_ in self._took.items():
            self._sum_up(name, all_)
        Answers(self._took, self._problems).fail()

    def _sum_up(self, name: str, took: list[float]) -> None:
        least, mean, most = (1000 * t for t in (min(took), sum(took) / len(took), max(took)))
        document = {"node": name, "n": len(took), "min": least, "avg": mean, "max": most}
        shown = f"{least:.2f}/{mean:.2f}/{most:.2f} ms"
        output.either(self._options, document, f"{name}: {len(took)} pongs, min/avg/max {shown}")

    def _once(self, processes: dict[str, ProcessRecord], until: float, name: str) -> float:
        """Return how long an answer took, s."""
        begun = time.monotonic()
        # A refusal, too, shows that its executor runs.
        with contextlib.suppress(Invalid):
            params_of(self._client, processes[name], [], max(until - begun, 0.001))
        return time.monotonic() - begun
