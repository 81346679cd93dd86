"""Fixtures that start real systems, each in its own realm and folder."""

import signal
from collections.abc import Iterator
from typing import Any

import hypothesis
import pytest

from tests.support import chromium
from tests.support.bare import Bare
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.proofs import Proofs

PROOFS = pytest.StashKey[Proofs]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[PROOFS] = Proofs()
    # A shell's background jobs ignore SIGINT and `nohup` ignores SIGHUP; so would every command
    # that a test starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # SIGTERM ends the tests as Ctrl-C does, which ends the realms that they started.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    # No deadline: the time of an example depends on the load of the machine.
    hypothesis.settings.register_profile("quadctl", deadline=None)
    hypothesis.settings.load_profile("quadctl")
    if config.option.markexpr:
        config.pluginmanager.register(FailuresAtOnce(config))
    config.addinivalue_line("markers", "prove: full counts, for `make prove`; otherwise left out")
    config.addinivalue_line(
        "markers", "alone: a count that measures times, or needs the whole machine"
    )
    config.addinivalue_line("markers", "needs(*capabilities): left out on a machine without them")
    config.addinivalue_line(
        "markers", "browser: drives a Chromium; without one left out, with a warning"
    )


class FailuresAtOnce:
    """Plugin that shows why a count failed when it did: those after it take hours."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        terminal = self._config.pluginmanager.get_plugin("terminalreporter")
        if report.failed and terminal is not None:
            terminal.section(report.nodeid, red=True)
            terminal.write_line(report.longreprtext)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not chromium.wanted():
        _leave_out("browser", config, items)
    if config.option.markexpr:
        # A worker that begins a long count as the last ends long after the others.
        items.sort(key=_time_limit, reverse=True)
    else:
        _leave_out("prove", config, items)


def _time_limit(item: pytest.Item) -> float:
    marker = item.get_closest_marker("timeout")
    return marker.args[0] if marker else 0.0


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if not chromium.wanted():
        terminalreporter.section("NOT TESTED", yellow=True, bold=True)
        terminalreporter.write_line(chromium.MISSING)


def _leave_out(marker: str, config: pytest.Config, items: list[pytest.Item]) -> None:
    left_out = [item for item in items if item.get_closest_marker(marker)]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]


def pytest_sessionfinish(session: pytest.Session) -> None:
    proofs = session.config.stash[PROOFS]
    output = getattr(session.config, "workeroutput", None)  # of a worker of pytest-xdist
    if output is None:
        proofs.write()
    else:
        output["proofs"] = proofs.found


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Take a worker's results: one process writes the file."""
    node.config.stash[PROOFS].found += getattr(node, "workeroutput", {}).get("proofs", [])


@pytest.fixture(scope="session")
def proofs(request: pytest.FixtureRequest) -> Proofs:
    """Results of the full counts (`make prove`)."""
    return request.config.stash[PROOFS]


@pytest.fixture
def lab() -> Iterator[Lab]:
    """Empty realm. Processes that the test starts in it must have ended when the test ends."""
    with private_lab() as made:
        yield made


@pytest.fixture(scope="session")
def shared_lab() -> Iterator[Lab]:
    """Running system that many tests share; the vehicle hovers at (0, 0, 1)."""
    with private_lab() as made:
        made.start("--set", "dynamics.start.z=1", *PATIENT)
        yield made


@pytest.fixture
def bare(shared_lab: Lab) -> Iterator[Bare]:
    """Third-party session on the shared lab: Zenoh and MessagePack, without `quadctl`."""
    with shared_lab.bare() as session:
        yield session


@pytest.fixture
def hover(bare: Bare) -> Bare:
    """`bare` with the vehicle at rest at (0, 0, 1), the cage on and the baseline 0."""
    states = bare.watch("uav/safety/state")
    for service, field in (("toggle_cage", "cage_on"), ("calibrate_pressure", "zero")):
        assert bare.call(service, **{field: field == "cage_on"}).ok
    boot = bare.state()["boot"]
    assert bare.call("reset").value == {"success": True}
    states.until(lambda s: s["boot"] != boot and s["state"] == "HOVERING" and s["goal"]["z"] == 1)
    return bare
