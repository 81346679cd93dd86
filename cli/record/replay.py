"""`replay`: a recording published on the bus again."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from quadctl.cli import context, output
from quadctl.cli.context import Options, about_topic, with_any_vehicle
from quadctl.cli.declarations import Arg, Option
from quadctl.cli.names import checked_key, is_single
from quadctl.cli.progress import Progress
from quadctl.cli.temporary_run import temporary_run
from quadctl.schemas.params import Params
from quadctl.services.runtime.bus.client import Client, Pace
from quadctl.services.runtime.bus.liveliness import covers
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.process_table import NODES
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.recording.reader import Bag, Recorded
from quadctl.services.runtime.run_files import is_live
from quadctl.services.runtime.supervisor.launch import Launch

_SHOWN_EVERY = 0.1  # s between two updates of the progress


def replay(
    options: Options,
    file: Annotated[Path, Arg("A recording, MCAP.", "FILE")],
    keys: Annotated[list[str] | None, Arg("Only these keys or expressions.")] = None,
    speed: Annotated[float, Option("Recorded seconds per second; 0: as fast as possible.")] = 1.0,
    start: Annotated[
        float, Option("Begin this many seconds into the recording.", ("--from",))
    ] = 0.0,
) -> None:
    """Publish a recording on the bus again, with the same bytes at the same intervals.

    If nothing runs in the realm, a hub runs for the replay. If the vehicle itself is live, the
    replay is refused (exit 7): subscribers could not distinguish the two.

    Example: quadctl replay flight.mcap --speed 2 --realm replay
    """
    if not 0 <= speed <= 1e6:
        raise Invalid(f"--speed {speed:g}: no speed", "give recorded seconds per second, or 0")
    if not 0 <= start <= 1e9:
        raise Invalid(f"--from {start:g}: no time", "give seconds after the recording's beginning")
    wanted = [checked_key(key, about_topic(options, key).vehicle) for key in keys or ()]
    options = with_any_vehicle(options)
    plan = _Plan(file, wanted, start)
    with _connection(options) as client:
        count, wall = _publish(client, plan, speed, quiet=options.json)
    document = {"file": str(file), "messages": count, "keys": len(plan.keys)}
    document |= {"seconds": plan.seconds, "wall_seconds": wall, "cut": plan.cut}
    document |= {"problem": plan.problem}
    if plan.problem:
        output.note(f"the recording is {plan.problem}")
    text = f"replayed {count} messages of {len(plan.keys)} keys, {plan.seconds:.1f} s"
    output.either(options, document, f"{text}, in {wall:.1f} s")


class _Plan:
    """Selected messages of a recording: `keys` with their encodings, and the duration (s)."""

    def __init__(self, file: Path, wanted: list[str], start: float) -> None:
        self._file, self._wanted = file, wanted
        bag = Bag(file)
        first = last = None
        for last in self._chosen(bag):
            first = first or last
        self.cut, self.problem = bag.cut, bag.problem
        self.begin = (first.at if first else 0) + round(start * 1e9)
        self.seconds = max((last.at - self.begin) / 1e9, 0.0) if last else 0.0
        self.keys = {message.key: message.encoding for message in self.messages()}
        if not self.keys:
            raise Invalid(f"{file} has nothing to replay", "`quadctl bag info` shows what is in it")
        if bad := [key for key in self.keys if not is_single(key)]:
            raise Invalid(
                f"{file}: {bad[0][:80]!r} is not a valid key", "name other keys to replay"
            )

    def messages(self) -> Iterator[Recorded]:
        """Return the selected messages, in order."""
        return (message for message in self._chosen(Bag(self._file)) if message.at >= self.begin)

    def _chosen(self, bag: Bag) -> Iterator[Recorded]:
        for message in bag.messages():
            chosen = not self._wanted or any(covers(key, message.key) for key in self._wanted)
            if chosen and not message.derived:
                yield message


@contextmanager
def _connection(options: Options) -> Iterator[Client]:
    """Connect to the realm's hub, or to a temporary one if nothing runs there."""
    realm = Realm(options.realm)
    if options.connect or is_live(realm) or realm.socket.exists():
        with context.connect(options) as client:
            yield client
        return
    others = [name for name in NODES if name != "hub"]
    launch = Launch(realm.name, {options.vehicle: Params()}, others, str(Path.cwd()))
    with temporary_run(launch), context.connect(options) as client:
        yield client


def _publish(client: Client, plan: _Plan, speed: float, *, quiet: bool) -> tuple[int, float]:
    """Publish all messages; return their number and the time taken (s)."""
    stage, count = client.stage(plan.keys), 0
    began = shown = time.monotonic()
    pace = Pace(client)
    with Progress("replaying", quiet=quiet) as progress:
        for message in plan.messages():
            at = (message.at - plan.begin) / 1e9
            if speed:
                pace.sleep_until(began + at / speed)
            stage.put(message.key, message.payload, message.encoding)
            count += 1
            if (now := time.monotonic()) - shown > _SHOWN_EVERY:
                shown = now
                progress.update(at / max(plan.seconds, 1e-9), f"{at:.1f} of {plan.seconds:.1f} s")
    client.flush()
    return count, time.monotonic() - began
