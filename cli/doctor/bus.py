"""Judges what was found on the bus, or that nothing could be; pure."""

from collections.abc import Iterator

from cli.doctor import offers, topics
from cli.doctor.barometer import barometer
from cli.doctor.check import Check, failed, passed, warned
from cli.doctor.settings import Settings, faults, parameters
from services.runtime.bus.survey import Survey
from services.runtime.errors import QuadctlError
from services.runtime.run_files import RunRecord

_NEED_THE_HUB = (
    "announced", "schemas", "servers", "publishers", "topics", "services", "clocks", "barometer",
    "parameters",
)  # fmt: skip


def bus(
    found: Survey | QuadctlError, run: RunRecord | None, settings: Settings, vehicle: str
) -> Iterator[Check]:
    """All checks of the bus; those that need a hub which does not answer are no PASS."""
    if isinstance(found, QuadctlError):
        fix = "`quadctl node logs hub`, `quadctl node restart hub`" if run else found.hint
        yield failed("hub answers", found.message, fix)
        for name in _NEED_THE_HUB:
            yield warned(name, "not checked: the hub does not answer")
        return
    yield passed("hub answers", f"{1000 * found.connected:.1f} ms")
    yield offers.announced(found, run)
    yield offers.schemas(found)
    yield offers.servers(found)
    yield topics.publishers(found)
    yield from topics.topics(found, vehicle)
    yield from offers.services(found)
    yield topics.clocks(found)
    yield from barometer(found, vehicle)
    replies = (answer.values for answers in found.answers.values() for answer in answers)
    running = {name: value for values in replies for name, value in values.items()}
    yield parameters(settings, running)
    yield faults(running)
