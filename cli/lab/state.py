"""`state`: what the automaton is doing."""

import msgspec

from cli import bus, output
from cli.options import Options
from schemas.topics import POSE, STATE


def state(options: Options) -> None:
    """Show what the automaton is doing, and where the vehicle is.

    Example: quadctl state --json
    """
    with bus.connect(options) as client:
        now, pose = client.latest(STATE), client.first(POSE)
    shown = msgspec.to_builtins(now) | {"pose": msgspec.to_builtins(pose)}
    if options.json:
        output.document(shown)
    else:
        output.fields(shown)
