"""`doctor`: all checks in order, with a hint for each that fails."""

import os
import time
from collections.abc import Iterator

from quadctl.cli import output
from quadctl.cli.context import Options
from quadctl.cli.doctor import run
from quadctl.cli.doctor.bus import bus
from quadctl.cli.doctor.check import Finding, failed, text_of, with_options
from quadctl.cli.doctor.gather import Facts, Place, gather
from quadctl.cli.doctor.host import clock, disk, load
from quadctl.cli.doctor.installation import environment, installation
from quadctl.cli.doctor.run import parameter_file
from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.realm import default_name


def doctor(options: Options) -> None:
    """Check the installation, the realm, and every process, topic and service of its run.

    Prints PASS, WARN or FAIL, the evidence and a fix; changes nothing. Exit 8 after any FAIL. A
    realm without a run is a WARN, a run that has died a FAIL.

    Example: quadctl doctor
    """
    facts = gather(options)
    checks = with_options(_judged(facts, options), _common(options))
    ok = not any(check.verdict == "FAIL" for check in checks)
    if options.json:
        output.document({"ok": ok, "checks": checks})
    else:
        for check in checks:
            output.line(text_of(check))
    output.end(ok=ok)


def _judged(facts: Facts, options: Options) -> Iterator[Finding]:
    yield from installation(facts.installed)
    yield environment(os.environ)
    yield clock(time.localtime().tm_year)
    yield disk(facts.disks)
    yield parameter_file(facts.settings)
    if isinstance(facts.place, UsageError):
        yield failed("realm", facts.place.message, facts.place.hint)
    elif facts.place is not None:
        yield from _place(facts.place, options.realm, facts.vehicle)
    if facts.found is not None:
        yield from bus(facts.found, facts.record, facts.settings, facts.vehicle)


def _place(place: Place, realm: str, vehicle: str) -> Iterator[Finding]:
    yield run.realm(realm, place.folder, place.neighbours, vehicle, place.before.get("up"))
    yield run.leftovers(place.neighbours)
    yield from run.nodes(place.folder, place.before)
    if place.before:
        yield load(place.before, place.after, place.seconds)


def _common(options: Options) -> str:
    """Return the common options that a command in the same shell needs for the same run."""
    vehicle = f"--vehicle {options.named}" if options.named else ""
    if options.connect:
        place = f"--connect {options.connect}"
    else:
        place = f"--realm {options.realm}" if options.realm != default_name() else ""
    return f"{place} {vehicle}".strip()
