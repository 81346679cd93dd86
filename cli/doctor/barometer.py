"""Judges the barometer by what it says; pure."""

from collections.abc import Iterable, Iterator, Sequence

from cli.doctor.check import Check, failed, passed, warned
from schemas.barometer import AIR
from schemas.messages import Pressure
from schemas.topics import PRESSURE
from services.runtime.bus import codec
from services.runtime.bus.survey import Survey
from services.runtime.errors import Invalid

_ALIKE = 8
"""So many readings that are the same to the last bit come from no sensor: each has noise, and of the
coarsest they are the same once in ten thousand times."""
_FIX = "`quadctl fault list`, `quadctl node restart pressure`; a real sensor: see to its wires"


def barometer(found: Survey, vehicle: str) -> Iterator[Check]:
    """Its readings are the air's, and change; nothing where there is none."""
    heard = found.heard.get(PRESSURE.key(vehicle))
    if heard is not None:
        yield judged(_readings(heard.newest))


def judged(readings: Sequence[float]) -> Check:
    """Of readings, hPa, the oldest first."""
    if not readings:
        return warned("barometer", "not checked: no reading came")
    low, high = AIR
    if beyond := [reading for reading in readings if not low <= reading <= high]:
        said = f"{beyond[-1]:g} hPa is not the pressure of air: it is {low:g} to {high:g} hPa"
        return failed("barometer", said, _FIX)
    if len(readings) < _ALIKE:
        return passed("barometer", f"{readings[-1]:.6g} hPa; too few to see whether it is stuck")
    if len(set(readings[-_ALIKE:])) == 1:
        said = f"stuck: {readings[-1]:.9g} hPa {_ALIKE} times over, with no noise"
        return warned("barometer", said, _FIX)
    return passed("barometer", f"{readings[-1]:.6g} hPa, and it changes")


def _readings(payloads: Iterable[bytes]) -> list[float]:
    """What was measured, before the baseline was taken off, hPa; what cannot be read is left out."""
    found = []
    for payload in payloads:
        try:
            reading = codec.decode_fields(Pressure, payload)
        except Invalid:
            continue
        found.append(reading.pressure + reading.baseline)
    return found
