"""Numbers of repetitions."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """Repetitions; the default ones make the figures of docs/figures.md.

    A run starts its processes anew. The system places them so differently that the ratio of two
    topics or calls differs from run to run by half: their median needs many short runs.
    """

    commands: int = 30
    ros_commands: int = 15
    runs: int = 3
    topic_runs: int = 7
    blocks: int = 3
    call_runs: int = 31
    launches: int = 20
    large_launches: int = 5
    ros_launches: int = 10
    cycles: int = 100
    kills: int = 10
    seconds: float = 20.0
    flights: int = 5
    hand_ins: int = 30


QUICK = Effort(
    commands=7, ros_commands=2, runs=1, topic_runs=1, blocks=2, call_runs=1, launches=3, large_launches=1,
    ros_launches=1, cycles=3, kills=2, seconds=3.0, flights=1, hand_ins=2,
)  # fmt: skip
