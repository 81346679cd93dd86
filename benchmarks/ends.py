"""Both ends of a service or a topic on each side, with the hub and the master."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import NamedTuple

from benchmarks import ros
from benchmarks.bars import Side
from benchmarks.children import PYTHON, Worker, workers
from benchmarks.system import REALM, hub

_Command = tuple[Sequence[str], Mapping[str, str]]


class Ends(NamedTuple):
    """One end that calls or publishes, and the ends that serve or subscribe."""

    sender: Worker
    receivers: list[Worker]


@contextmanager
def ends(
    sender: str, receiver: str, receivers: int, size: int, *, by_hand: bool = False
) -> Iterator[dict[Side, Ends]]:
    """Start a hub, a master, and the ends of each installed side; wait until all are ready.

    `sender` and `receiver` are roles of the workers, `size` is the payload of bare Zenoh (bytes).
    With `by_hand`, the ends on bare Zenoh encode and decode our type with msgspec.
    """
    with ExitStack() as stack:
        home = stack.enter_context(hub())

        def ours(name: str, role: str) -> _Command:
            return [*PYTHON, "benchmarks.ours.node", REALM, name, role], home.environment

        def raw(_name: str, role: str) -> _Command:
            kind = f"{role}_pose" if by_hand else role
            return [*PYTHON, "benchmarks.raw.node", home.endpoint, kind, str(size)], home.raw

        makers: dict[Side, Callable[[str, str], _Command]] = {"ours": ours, "raw": raw}
        if not ros.absent():
            makers["ros"] = stack.enter_context(ros.master(home.folder / "ros")).node
        found: dict[Side, Ends] = {}
        for side, make in makers.items():
            # The receiving ends first, so that a caller finds its server, a publisher its subscribers.
            names = [f"{receiver}{number}" for number in range(receivers)]
            heard = stack.enter_context(workers(*(make(name, receiver) for name in names)))
            (sent,) = stack.enter_context(workers(make(sender, sender)))
            found[side] = Ends(sent, heard)
        yield found
