"""`campaign --dask`: the same flights on a cluster, whatever its workers are or become."""

import json
import signal
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from quadctl.services.campaign.cluster import connect
from quadctl.services.runtime.errors import UsageError
from tests.support.campaign_flights import kept
from tests.support.compiled import compiled_kernel
from tests.support.lab import Lab, private_lab
from tests.support.proofs import Proofs
from tests.support.running import Foreground, alive, eventually

FLIGHTS = ("campaign", "--flights", 40, "--seconds", 4, "--seed", 3, "--faults", "--json")
JOBS = ("--processes", 20)
ENDLESS = ("campaign", "--flights", 1_000_000, *JOBS, "--dask")
TLS = ("--tls-ca-file", "keys/hub/ca.pem", "--tls-cert", "keys/hub/cert.pem", "--tls-key", "keys/hub/key.pem")  # fmt: skip
DYING = """
import itertools, os, signal
from quadctl.services.campaign import cluster
def dask_setup(worker):
    fly, calls = cluster.fly, itertools.count()
    def fly_or_die(job):
        if next(calls) == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        return fly(job)
    cluster.fly = fly_or_die
"""
"""Preload of a worker that dies at its second job; its first call is the probe."""
WRONG = """
from quadctl.services.campaign import cluster
def dask_setup(worker):
    fly = cluster.fly
    cluster.fly = lambda job: fly(job).replace(b"0", b"1")
"""
"""Preload of a worker that calculates differently."""

QUIET = ("", "still starting: the first campaign of a machine compiles the vehicle\n")
"""What a campaign may print on stderr: the note after 5 s of a start, which a busy machine takes."""


@pytest.fixture(scope="module")
def module_lab() -> Iterator[Lab]:
    with private_lab() as made:
        yield made


@pytest.fixture(scope="module")
def report(module_lab: Lab) -> Any:
    """Report of the flights without a cluster."""
    compiled_kernel()
    return module_lab.quadctl(*FLIGHTS, timeout=200.0).json


def dask(lab: Lab, kind: str, *words: str) -> Foreground:
    module = f"distributed.cli.dask_{kind}"
    return lab.spawn(sys.executable, "-P", "-m", module, "--no-dashboard", *TLS, *words)


def worker(lab: Lab, name: str, *words: str) -> Foreground:
    one = ("--name", name, "--nthreads", "1", "--no-nanny", "--local-directory", name)
    return dask(lab, "worker", "--scheduler-file", "scheduler.json", *one, *words)


def worker_with_old_msgspec(lab: Lab, name: str) -> Foreground:
    metadata = lab.folder / "site/msgspec-0.1.dist-info/METADATA"
    metadata.parent.mkdir(parents=True)
    metadata.write_text("Metadata-Version: 2.1\nName: msgspec\nVersion: 0.1\n", encoding="utf-8")
    lab.environment["PYTHONPATH"] = str(metadata.parents[1])
    made = worker(lab, name)
    del lab.environment["PYTHONPATH"]
    return made


def scheduler(lab: Lab) -> tuple[Foreground, str]:
    """Start a scheduler with certificates of a fleet of its own, and return its address too."""
    for words in ("init", "issue hub", "issue operator"):
        assert lab.quadctl("keys", *words.split()).code == 0
    lab.environment["QUADCTL_IDENTITY"] = str(lab.folder / "keys/operator")
    at = ("--protocol", "tls", "--host", "127.0.0.1", "--port", "0")
    process = dask(lab, "scheduler", *at, "--scheduler-file", "scheduler.json")
    file = lab.folder / "scheduler.json"
    address = eventually(
        lambda: file.exists() and file.read_text("utf-8"), 30.0, lambda: process.log
    )
    return process, json.loads(str(address))["address"]


@pytest.mark.thorough
def test_workers_that_die_or_differ_leave_the_report_the_same(lab: Lab, report: Any):
    central, address = scheduler(lab)
    nobody = lab.quadctl(*FLIGHTS, "--dask", address)
    assert (nobody.code, nobody.out) == (3, "")
    assert "no worker that can fly" in nobody.error["message"]

    for name, text in (("dying", DYING), ("wrong", WRONG)):
        lab.file(text, f"{name}.py")
    steady, dying = worker(lab, "steady"), worker(lab, "dying", "--preload", "dying.py")
    others = worker(lab, "wrong", "--preload", "wrong.py"), worker_with_old_msgspec(lab, "old")
    workers = (steady, dying, *others)
    eventually(lambda: all("Registered to:" in each.log for each in workers))
    done = lab.quadctl(*FLIGHTS, *JOBS, "--dask", address)
    assert (done.code, done.json) == (0, report)
    assert dying.ended
    assert "worker wrong is left out: its probe flight differs from the one flown here" in done.err
    assert "worker old is left out: msgspec 0.1 there, " in done.err
    assert done.err.count(" is left out: ") == 2

    # Ctrl-C ends our flights, not somebody's cluster; and without a scheduler nothing waits.
    flying = lab.spawn(*lab.command(*ENDLESS, address))
    eventually(lambda: flies(flying))
    flying.send(signal.SIGINT)
    assert flying.wait() == 130
    flying = lab.spawn(*lab.command(*ENDLESS, address))
    eventually(lambda: flies(flying))
    assert alive(steady.pid)
    central.end()
    assert flying.wait() == 3, flying.log
    assert "has gone" in flying.log
    for each in workers:
        each.end()


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(1800)
def test_20_000_flights_have_one_hash_however_they_are_flown(lab: Lab, proofs: Proofs):
    compiled_kernel()
    words = ("campaign", "--flights", 20_000, "--seed", 11, "--json")

    def digest(*more: object) -> str:
        done = lab.quadctl(*words, *more, timeout=600.0)
        assert done.code == 0, done.err
        return str(done.json["hash"])

    hashes = {f"{count} processes": digest("--processes", count) for count in (1, 2, 4)}
    hashes["Dask's own"] = digest("--dask", "local")

    central, address = scheduler(lab)
    workers = worker(lab, "steady"), worker(lab, "dying")
    eventually(lambda: all("Registered to:" in each.log for each in workers))
    flying = lab.spawn(*lab.command(*words, "--db", "dask.sqlite", "--dask", address))
    eventually(lambda: kept(lab.folder / "dask.sqlite") > 4000, 300.0)
    workers[1].send(signal.SIGKILL)
    assert flying.wait(600.0) == 0
    hashes["a cluster, a worker killed"] = digest("--db", "dask.sqlite")
    central.end()
    workers[0].end()

    flying = lab.spawn(*lab.command(*words, "--db", "killed.sqlite"))
    eventually(lambda: kept(lab.folder / "killed.sqlite") > 4000, 300.0)
    flying.send(signal.SIGKILL)
    flying.wait()
    assert kept(lab.folder / "killed.sqlite") < 20_000
    hashes["killed and continued"] = digest("--db", "killed.sqlite")
    proofs.add(
        "20 000 flights: different hashes by 1, 2 and 4 processes, by Dask, by a cluster of which a"
        " worker is killed, and continued after kill -9",
        f"{len(set(hashes.values()))} of {len(hashes)}",
        "1",
    )
    assert len(set(hashes.values())) == 1, hashes


def flies(campaign: Foreground) -> bool:
    return "left out: msgspec" in campaign.log


@pytest.mark.thorough
def test_processes_of_this_machine_fly_the_same(module_lab: Lab, report: Any):
    compiled_kernel()
    done = module_lab.quadctl(*FLIGHTS, "--dask", "local", "--processes", 2)
    assert (done.code, done.json) == (0, report)
    assert done.err in QUIET


@pytest.mark.thorough
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_a_command_that_ends_leaves_no_worker(lab: Lab, end: int):
    flying = lab.spawn(*lab.command(*ENDLESS, "local", "--processes", 1, "--json"))
    # The command, the campaign, its own worker, and Dask's: a worker and the tracker of resources.
    eventually(lambda: len(lab.processes()) >= 5)
    flying.send(end)
    assert flying.wait() == (130 if end == signal.SIGINT else -end)
    eventually(lambda: not lab.processes())
    assert flying.log in QUIET


@pytest.mark.thorough
def test_an_impossible_cluster_is_refused_with_the_reason(lab: Lab):
    reasons = {
        "tcp://10.0.0.1:8786": (2, "neither encrypted nor local"),
        "tcp://127.evil:8786": (2, "neither encrypted nor local"),
        "tls://10.0.0.1:8786": (2, "needs an identity"),
        "10.0.0.1": (2, "not the address of a scheduler"),
        "tcp://127.0.0.1:1": (3, "no Dask scheduler answers"),
    }
    ended = lab.each([f"campaign --json --dask {address}" for address in reasons])
    for done, (code, reason) in zip(ended.values(), reasons.values(), strict=True):
        assert (done.code, done.out) == (code, "")
        assert reason in done.error["message"]


def test_without_the_extra_the_error_names_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError) as raised, connect("local", 1, insecure=False):
        pass
    assert "pip install 'quadctl[cluster]'" in raised.value.hint
