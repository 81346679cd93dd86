"""Numbers of repetitions."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """Repetitions; the default ones make the figures of docs/figures.md."""

    commands: int = 30
    ros_commands: int = 15
    runs: int = 3
    blocks: int = 5
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
    commands=7, ros_commands=2, runs=1, blocks=2, call_runs=1, launches=3, large_launches=1,
    ros_launches=1, cycles=3, kills=2, seconds=3.0, flights=1, hand_ins=2,
)  # fmt: skip
