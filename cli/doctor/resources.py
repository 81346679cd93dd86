"""Judges disks, processor, memory and clock; pure."""

from collections.abc import Mapping, Sequence

from cli.doctor.check import Check, failed, passed, warned
from cli.doctor.machine import Disk, Process

MB = 1e6
_SCARCE, _NONE = 200 * MB, 10 * MB
_BUSY = 0.9
"""Of one core."""
_LARGE = 200 * MB
_FIRST_YEAR = 2024


def disk(disks: Sequence[Disk]) -> Check:
    """Room for logs, recordings and the run's files."""
    for found in disks:
        if found.refused:
            return failed(
                "disk",
                f"{found.folder} cannot be written to: {found.refused}",
                f"`df {found.folder}` and `ls -ld {found.folder}` say why",
            )
    least = min(disks, key=lambda found: found.free)
    said = f"{least.free / MB:.0f} MB free at {least.folder}"
    fix = f"`df -h {least.folder}`, and remove what is not needed"
    if least.free < _NONE:
        return failed("disk", said, fix)
    return warned("disk", said, fix) if least.free < _SCARCE else passed("disk", said)


def clock(year: int) -> Check:
    """The system's clock, by which calls have their deadline."""
    if year < _FIRST_YEAR:
        return failed("clock", f"it is the year {year}", "`timedatectl set-ntp true`")
    return passed("clock", f"it is the year {year}")


def load(before: Mapping[str, Process], after: Mapping[str, Process], seconds: float) -> Check:
    """What the processes take of a core and of the memory; unknown where there is no /proc."""
    # A process that has been started again in between has begun to count anew.
    cores = {
        name: max(after[name].seconds - then.seconds, 0) / seconds
        for name, then in before.items()
        if name in after and seconds
    }
    greedy = [f"{name} takes {use:.0%} of a core" for name, use in cores.items() if use > _BUSY]
    greedy += [
        f"{name} takes {now.memory / MB:.0f} MB"
        for name, now in after.items()
        if now.memory > _LARGE
    ]
    if greedy:
        return warned(
            "load",
            ", ".join(greedy),
            "`quadctl param get dynamics`: a high rate, or a speed other than 1, takes what it gets",
        )
    memory = sum(process.memory for process in after.values())
    if not memory:
        return passed("load", "this system does not tell")
    return passed("load", f"{sum(cores.values()):.0%} of a core, {memory / MB:.0f} MB in all")
