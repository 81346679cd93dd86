"""Facts that `doctor` judges, gathered under one deadline."""

import os
import threading
import time
from pathlib import Path
from typing import NamedTuple

from quadctl.cli.context import Options
from quadctl.cli.doctor import host
from quadctl.cli.doctor.host import DiskSpace, Folder, Neighbours, ProcessFacts
from quadctl.cli.doctor.installation import Installed, installed
from quadctl.cli.doctor.run import Settings, settings
from quadctl.services.runtime import vehicles
from quadctl.services.runtime.bus.session import Address, address_of
from quadctl.services.runtime.bus.survey import Survey, survey
from quadctl.services.runtime.errors import QuadctlError, TimedOut, Unreachable, UsageError
from quadctl.services.runtime.realm import DEFAULT, Realm
from quadctl.services.runtime.run_files import RunState

_MARGIN = 0.1
"""Seconds of the timeout kept for the judging and printing afterwards."""


class TopicWatch:
    """Survey in the background, ended by its timeout (s) in any case; none without an address."""

    def __init__(self, address: Address | None, vehicle: str, timeout: float) -> None:
        self._found: Survey | BaseException | None = None
        timeout = max(timeout - _MARGIN, _MARGIN)
        self._deadline = time.monotonic() + timeout
        self._thread: threading.Thread | None = None
        if address is not None:
            self._thread = threading.Thread(
                target=self._look, args=(address, vehicle, timeout), daemon=True
            )
            self._thread.start()

    def result(self) -> Survey | QuadctlError | None:
        """Return the survey, or the error that prevented it; None without an address."""
        if self._thread is None:
            return None
        self._thread.join(max(self._deadline - time.monotonic(), 0) + _MARGIN)
        if self._thread.is_alive():
            return TimedOut("the hub accepts connections but does not answer")
        if isinstance(self._found, BaseException) and not isinstance(self._found, QuadctlError):
            raise self._found
        return self._found

    def _look(self, address: Address, vehicle: str, timeout: float) -> None:
        try:
            self._found = survey(address, vehicle, timeout)
        except BaseException as error:  # noqa: BLE001 - result() reports it
            self._found = error


class Place(NamedTuple):
    """Facts about a realm; `before` and `after` are by node, with the supervisor as `up`."""

    folder: Folder
    neighbours: Neighbours
    before: dict[str, ProcessFacts]
    after: dict[str, ProcessFacts]
    seconds: float


class Facts(NamedTuple):
    """All facts to judge; `place` and `found` may be the error that prevented them.

    `place` is None if a hub is named instead of a realm, `found` if there is no hub to ask.
    """

    vehicle: str
    installed: Installed
    settings: Settings
    disks: list[DiskSpace]
    place: Place | UsageError | None
    found: Survey | QuadctlError | None

    @property
    def record(self) -> RunState | None:
        """Return the record of a live run."""
        if isinstance(self.place, Place) and self.place.folder.live:
            return self.place.folder.run
        return None


def gather(options: Options) -> Facts:
    """Gather all facts; this takes about two seconds, and at most `options.timeout` s."""
    vehicle, vehicles = _vehicles(options)
    realm, problem = _realm(options)
    here = host.folder(realm) if realm else None
    address = Address(options.connect) if options.connect else None
    if realm and here and (here.live or here.by_hand):
        address = address_of(realm)
    watch = TopicWatch(address, vehicle, options.timeout)
    began, before = time.monotonic(), _processes(here)
    install, file, disks = installed(), settings(vehicle, vehicles), _disks(realm)
    around = host.neighbours(realm) if realm else None
    found = watch.result()
    place: Place | UsageError | None = problem
    if here and around:
        seconds = time.monotonic() - began
        place = Place(here, around, before, _processes(here), seconds)
    return Facts(vehicle, install, file, disks, place, found)


def _vehicles(options: Options) -> tuple[str, list[str]]:
    """Return the vehicle, and all of its run; a check reports a hub that does not answer."""
    hub = "" if options.connect or options.named else vehicles.standalone_hub(options.realm)
    if hub:
        return hub, [hub]
    try:
        return options.vehicle, options.vehicles
    except (Unreachable, TimedOut):
        vehicle = options.named or DEFAULT
        return vehicle, [vehicle]


def _realm(options: Options) -> tuple[Realm | None, UsageError | None]:
    if options.connect:
        return None, None
    try:
        return Realm(options.realm), None
    except UsageError as error:
        return None, error


def _processes(here: Folder | None) -> dict[str, ProcessFacts]:
    """Return the facts about each node's process, and about the supervisor's as `up`."""
    if here is None or here.run is None or not here.live:
        return {}
    pids = {node.name: node.pid for node in here.run.nodes if node.pid} | {"up": here.run.pid}
    return {name: host.process(pid) for name, pid in pids.items()}


def _disks(realm: Realm | None) -> list[DiskSpace]:
    try:
        disks = [host.look_at_disk(Path.cwd(), writing=False)]
    except FileNotFoundError:
        disks = [DiskSpace(".", 0, "it has been removed")]
    if realm and _is_folder(realm.folder):
        disks.append(host.look_at_disk(realm.folder, writing=True))
    elif realm:
        # `up` would create the folder there.
        parent = next(path for path in realm.folder.parents if _is_folder(path))
        refused = "" if os.access(parent, os.W_OK) else "no permission"
        disks.append(host.look_at_disk(parent, writing=False)._replace(refused=refused))
    return disks


def _is_folder(folder: Path) -> bool:
    try:
        return folder.is_dir()
    except PermissionError:
        return False
