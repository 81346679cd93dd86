"""Dask cluster that flies a campaign's jobs: somebody's scheduler, or processes of our own.

Dask shares the jobs out, and flies those of a worker that dies on another one. A flight depends on
its seed alone, so the report is the same. Before a worker gets jobs, it must have our versions
and fly a probe flight to the same result to the last bit; so must each that joins later.
"""

import logging
import os
import re
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from functools import cache
from importlib import metadata
from ipaddress import ip_address
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

import msgspec

from quadctl.schemas.typed import from_json
from quadctl.services.campaign.batch import MakeFleet
from quadctl.services.campaign.score import Flown
from quadctl.services.campaign.vehicles import Plain
from quadctl.services.campaign.workers import Job, batch, compiled
from quadctl.services.runtime.errors import QuadctlError, TimedOut, Unreachable, UsageError
from quadctl.services.runtime.security import identity

if TYPE_CHECKING:
    from distributed import Client, Future

LOCAL = "local"
_FORM = r"(?:tcp|tls)://(\[[^]]+\]|[^/:]+):\d{1,5}"
_PACKAGES = ("distributed", "msgspec", "numba", "numpy", "quadctl")
"""Packages that must be equal: the flights and their encoding depend on them."""

_REPLY = 5.0
"""Time (s) for the scheduler to answer."""
_PROBE = 60.0
"""Time (s) for a probe flight: a worker that flies for the first time compiles the vehicle."""
_REJOIN = 30.0
"""Time (s) to wait for a worker when all have gone; one that restarts is back sooner."""
_LOOK = 0.5
"""Time (s) between looks for workers that have joined or gone."""
_AHEAD = 2
"""Jobs at the cluster per thread: one flies and one waits, so that memory stays constant."""


@contextmanager
def connect(address: str, processes: int, *, insecure: bool) -> "Iterator[Client]":
    """Connect to the scheduler at an address, or start `processes` workers for `local`.

    Raises UsageError for an address that is none or that is open to a network, or without Dask, and
    Unreachable if no scheduler answers.
    """
    ours = None if address == LOCAL else _identity(address, insecure=insecure)
    try:
        from distributed import Client, LocalCluster, Security
        from distributed.versions import VersionMismatchWarning
    except ImportError as error:
        raise UsageError(
            f"--dask needs the package {error.name}, which is not installed",
            "`pip install 'quadctl[cluster]'`, into the same environment",
        ) from error
    # Both would repeat on stderr, in Dask's words, what we check and report ourselves.
    logging.disable()
    warnings.simplefilter("ignore", VersionMismatchWarning)
    if address == LOCAL:
        # After kill -9 multiprocessing would report what it cleans up.
        os.environ["PYTHONWARNINGS"] = "ignore:resource_tracker"
        # Encrypted: other users of this machine could run code on open workers.
        with (
            LocalCluster(
                n_workers=processes,
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                security=True,
                memory_limit=0,
                silence_logs=logging.CRITICAL,
            ) as cluster,
            Client(cluster, set_as_default=False) as client,
        ):
            yield client
        return
    security = ours and Security(
        require_encryption=True,
        tls_ca_file=ours.path(identity.FLEET),
        tls_client_cert=ours.path(identity.CERTIFICATE),
        tls_client_key=ours.path(identity.KEY),
    )
    try:
        client = Client(address, timeout=_REPLY, security=security, set_as_default=False)
    except OSError as error:
        raise Unreachable(
            f"no Dask scheduler answers at {address} within {_REPLY:g} s",
            f"start it on that machine: `dask scheduler`; is the address right? ({error})",
        ) from error
    with client:
        yield client


def _identity(address: str, *, insecure: bool) -> identity.Identity | None:
    """Return our identity for an encrypted scheduler, None for a plain one; raise UsageError."""
    found = re.fullmatch(_FORM, address)
    if not found:
        raise UsageError(
            f"--dask {address}: not the address of a scheduler",
            f"write tls://HOST:PORT, tcp://127.0.0.1:PORT, or {LOCAL} for processes of this machine",
        )
    if address.startswith("tls:"):
        return identity.needed(address)
    if not insecure and not _is_loopback(found[1].strip("[]")):
        raise UsageError(
            f"{address} is neither encrypted nor local: anyone on the network could run programs"
            " on its workers",
            f"use tls{address.removeprefix('tcp')} with an identity (`quadctl keys --help`), or"
            " --insecure",
        )
    return None


def _is_loopback(host: str) -> bool:
    with suppress(ValueError):
        return ip_address(host).is_loopback
    return host == "localhost"


class _Flight(msgspec.Struct, frozen=True):
    """Job at the cluster, and the addresses of the workers that may fly it."""

    job: Job
    workers: frozenset[str]


class _Probe(msgspec.Struct, frozen=True):
    """Probe flight of one worker, and its deadline (monotonic, s)."""

    worker: str
    deadline: float


class ClusterPool:
    """Workers of a cluster that passed their probe flight, and the jobs that they fly."""

    def __init__(
        self,
        client: "Client",
        jobs: list[Job],
        on_flown: Callable[[list[Flown]], None],
        on_note: Callable[[str], None],
    ) -> None:
        """Call `on_flown` with the results of each job, and `on_note` with each worker left out."""
        self._client, self._jobs = client, deque(jobs)
        self._on_flown, self._on_note = on_flown, on_note
        assert client.scheduler is not None  # noqa: S101 - it is connected
        self._scheduler = client.scheduler
        self._address = self._scheduler.address
        self._ours = versions()
        self._workers: dict[str, Any] = {}
        """All workers at the last look, by address."""
        self._passed: set[str] = set()
        self._probes: dict[Future[Any], _Probe] = {}
        self._flying: dict[Future[Any], _Flight] = {}
        self._ended: SimpleQueue[Future[Any]] = SimpleQueue()
        self._looked = self._staffed = 0.0
        """Times (monotonic, s) of the last look, and of the last one that found a worker."""

    def fly(self, probe: Job, expected: list[Flown]) -> None:
        """Fly all jobs on workers that fly the probe to the expected result.

        Raises Unreachable if there is none or the scheduler has gone, TimedOut if it does not
        answer, and QuadctlError if a job fails.
        """
        self._probe = msgspec.json.encode(probe)
        self._expected = msgspec.json.encode(expected)
        self._look()
        while self._probes:
            self._wait()
        if not self._passed:
            raise Unreachable(
                f"{self._address} has no worker that can fly this campaign",
                "start workers with the versions of this machine: `dask worker ADDRESS`",
            )
        while self._jobs or self._flying:
            self._feed()
            self._wait()

    def _feed(self) -> None:
        """Send jobs while the workers that passed have room."""
        threads = sum(self._workers[address]["nthreads"] for address in self._passed)
        while self._jobs and len(self._flying) < _AHEAD * threads:
            job, workers = self._jobs.popleft(), frozenset(self._passed)
            future = self._submit(workers, fly, msgspec.json.encode(job))
            self._flying[future] = _Flight(job, workers)

    def _submit(self, workers: frozenset[str], *call: Any) -> "Future[Any]":
        # Not pure: Dask would answer the same call of another campaign from memory.
        future = self._client.submit(*call, workers=list(workers), pure=False)
        future.add_done_callback(self._ended.put)
        return future

    def _wait(self) -> None:
        """Wait for the end of a call or for the next look."""
        with suppress(Empty):
            self._settle(self._ended.get(timeout=_LOOK))
        if time.monotonic() > self._looked + _LOOK:
            self._look()

    def _settle(self, future: "Future[Any]") -> None:
        """Take the result of a call that has ended; ignore one that was given up."""
        probe, flight = self._probes.pop(future, None), self._flying.pop(future, None)
        if not probe and not flight:
            return
        try:
            problem = future.exception(_REPLY)
            result: Any = None if problem else future.result(_REPLY)
        except TimeoutError:
            # The worker has gone with its result; the next look would drop its probe too.
            if flight:
                self._jobs.appendleft(flight.job)
            return
        except (CancelledError, OSError) as error:
            raise Unreachable(
                f"the Dask scheduler at {self._address} has gone, or cancelled the flights",
                f"is it still running? ({error})",
            ) from error
        finally:
            future.release()
        if probe:
            self._judge(probe.worker, problem, result)
        elif problem:
            raise QuadctlError(
                f"a job failed on the cluster: {problem!r}", "the workers' logs say more"
            )
        else:
            self._on_flown(from_json(result, list[Flown]))

    def _judge(self, worker: str, problem: BaseException | None, result: Any) -> None:
        """Accept a worker, or leave it out, by the result of its probe."""
        if problem:
            return self._leave_out(worker, f"its probe flight failed: {problem!r}")
        theirs, flown = result
        different = [
            f"{name} {theirs.get(name, 'missing')} there, {version} here"
            for name, version in self._ours.items()
            if theirs.get(name) != version
        ]
        if different:
            return self._leave_out(worker, "; ".join(different))
        if flown != self._expected:
            return self._leave_out(worker, "its probe flight differs from the one flown here")
        self._passed.add(worker)
        return None

    def _leave_out(self, worker: str, why: str) -> None:
        self._on_note(f"worker {self._workers[worker]['name']} is left out: {why}")

    def _look(self) -> None:
        """Probe workers that have joined, and take back the calls of those that have gone."""
        known, self._workers = self._workers.keys(), self._ask_workers()
        now = self._looked = time.monotonic()
        self._passed &= self._workers.keys()
        for future, probe in list(self._probes.items()):
            gone = probe.worker not in self._workers
            if gone or now > probe.deadline:
                del self._probes[future]
                future.release()
            if not gone and now > probe.deadline:
                self._leave_out(probe.worker, f"no probe flight within {_PROBE:g} s")
        for address in self._workers.keys() - known:
            future = self._submit(frozenset((address,)), check, self._ours, self._probe)
            self._probes[future] = _Probe(address, now + _PROBE)
        for future, flight in list(self._flying.items()):
            # Dask has moved the others to workers that are left.
            if flight.workers.isdisjoint(self._workers):
                del self._flying[future]
                future.release()
                self._jobs.appendleft(flight.job)
        if self._passed or self._probes:
            self._staffed = now
        elif self._staffed and now > self._staffed + _REJOIN:
            raise Unreachable(
                f"all workers of {self._address} have gone, and none has come back in {_REJOIN:g} s",
                "start workers: `dask worker ADDRESS`, and repeat the campaign",
            )

    def _ask_workers(self) -> dict[str, Any]:
        ask = self._scheduler.identity
        try:
            found = self._client.sync(ask, callback_timeout=_REPLY, n_workers=-1)
        except TimeoutError as error:
            raise TimedOut(
                f"the Dask scheduler at {self._address} did not answer within {_REPLY:g} s",
                "is its process frozen?",
            ) from error
        except OSError as error:
            raise Unreachable(
                f"the Dask scheduler at {self._address} has gone: {error}", "is it still running?"
            ) from error
        workers: dict[str, Any] = found["workers"]
        return workers


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that must be equal, by name."""
    found = {"Python": "{}.{}".format(*sys.version_info)}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "missing"
    return found


def check(ours: dict[str, str], probe: bytes) -> tuple[dict[str, str], bytes]:
    """Return a worker's versions and, if they are ours, the flight of the probe; runs there."""
    theirs = versions()
    return theirs, fly(probe) if theirs == ours else b""


def fly(job: bytes) -> bytes:
    """Fly a job, and return its `list[Flown]`, both as JSON; runs on a worker."""
    with _turn:
        make = _maker()
    return msgspec.json.encode(batch(from_json(job, Job), make).fly())


_turn = threading.Lock()
"""Lock for the threads of a worker: only one loads the kernel."""


@cache
def _maker() -> MakeFleet:
    return compiled() or Plain
