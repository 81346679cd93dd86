"""Fixtures that start real systems, each in its own realm and folder."""

import gc
import signal
from collections.abc import Callable, Iterator
from typing import Any

import hypothesis
import pytest

from tests.support import abilities
from tests.support.bare import Bare
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.proofs import Proofs

PROOFS = pytest.StashKey[Proofs]()
MISSING = pytest.StashKey[list[str]]()
LEFT_OUT = pytest.StashKey[list[tuple[str, str]]]()
THOROUGH = pytest.StashKey[int]()
"""Number of thorough tests that were left out."""
"""Tests that this machine cannot run, each after the ability that it lacks for it."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--complete", action="store_true", help="fail if this machine cannot run some of the tests"
    )


def pytest_configure(config: pytest.Config) -> None:
    gc.disable()
    config.stash[PROOFS] = Proofs()
    config.stash[LEFT_OUT] = []
    config.stash[THOROUGH] = 0
    worker = getattr(config, "workerinput", None)  # of a worker of pytest-xdist
    config.stash[MISSING] = abilities.missing() if worker is None else worker["missing"]
    # A shell's background jobs ignore SIGINT and `nohup` ignores SIGHUP; so would every command
    # that a test starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # SIGTERM ends the tests as Ctrl-C does, which ends the realms that they started.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    # No deadline: the time of an example depends on the load of the machine. The examples are the
    # same in each run, and independent of the variable CI; `make prove` looks for others.
    same = hypothesis.settings(
        hypothesis.settings.get_profile("default"),
        deadline=None,
        derandomize=True,
        database=None,
        max_examples=50,
    )
    hypothesis.settings.register_profile("quadctl", same)
    hypothesis.settings.register_profile("explore", same, derandomize=False, max_examples=1000)
    hypothesis.settings.load_profile(config.option.hypothesis_profile or "quadctl")
    if config.option.markexpr:
        config.pluginmanager.register(FailuresAtOnce(config))
    for marker in (
        "thorough: for `make test-all`, left out of `make test`",
        "prove: full counts, for `make prove`; otherwise left out",
        "alone: a count that measures times, or needs the whole machine",
        "needs(ability, ...): left out on a machine without it, and listed at the end",
    ):
        config.addinivalue_line("markers", marker)


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
    # A test that is named by its id is wanted, whatever its mark.
    if config.option.markexpr or any("::" in each for each in config.args):
        # A worker that begins a long count as the last ends long after the others.
        items.sort(key=_time_limit, reverse=True)
    else:
        config.stash[THOROUGH] = len(
            [each for each in items if each.get_closest_marker("thorough")]
        )
        _leave_out(
            config, items, lambda item: any(map(item.get_closest_marker, ("prove", "thorough")))
        )
    if config.option.collectonly:
        return
    lacks = {item: found for item in items if (found := _lacks(item, config.stash[MISSING]))}
    config.stash[LEFT_OUT] = [(ability, item.nodeid) for item, ability in lacks.items()]
    _leave_out(config, items, lacks.__contains__)


def _lacks(item: pytest.Item, missing: list[str]) -> str | None:
    """Return the first ability that this machine lacks for a test, or None."""
    needed = {name for marker in item.iter_markers("needs") for name in marker.args}
    unknown = needed - abilities.ABILITIES.keys()
    assert not unknown, f"{item.nodeid} needs {unknown}, which tests/support/abilities.py lacks"
    return next((name for name in missing if name in needed), None)


def _time_limit(item: pytest.Item) -> float:
    marker = item.get_closest_marker("timeout")
    return marker.args[0] if marker else 0.0


def _leave_out(
    config: pytest.Config, items: list[pytest.Item], unwanted: Callable[[pytest.Item], object]
) -> None:
    left_out = {item: None for item in items if unwanted(item)}
    if left_out:
        config.hook.pytest_deselected(items=list(left_out))
        items[:] = [item for item in items if item not in left_out]


def pytest_collection_finish() -> None:
    # The thousands of tests stay until the end; the collector need not look through them each time.
    gc.freeze()
    gc.enable()


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    if thorough := config.stash[THOROUGH]:
        terminalreporter.write_line(
            f"{thorough} thorough tests of these were left out: -m 'not prove' runs them, too"
        )
    whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS and not config.option.keyword
    if whole and (left_out := config.stash[LEFT_OUT]):
        terminalreporter.section("NOT TESTED", yellow=True, bold=True)
        for line in abilities.report(left_out):
            terminalreporter.write_line(line)


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    stash = session.config.stash
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["proofs"], output["left_out"] = stash[PROOFS].found, stash[LEFT_OUT]
        output["thorough"] = stash[THOROUGH]
        return
    stash[PROOFS].write()
    if session.config.option.complete and stash[LEFT_OUT] and exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Give a worker the result of the probes."""
    node.workerinput["missing"] = node.config.stash[MISSING]


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Take a worker's results: one process writes the file."""
    output = getattr(node, "workeroutput", {})
    node.config.stash[PROOFS].found += output.get("proofs", [])
    # Each worker collects all tests.
    node.config.stash[LEFT_OUT] = output.get("left_out", node.config.stash[LEFT_OUT])
    node.config.stash[THOROUGH] = output.get("thorough", node.config.stash[THOROUGH])


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
        made.share("--set", "dynamics.start.z=1", *PATIENT)
        yield made


@pytest.fixture
def bare(shared_lab: Lab) -> Iterator[Bare]:
    """Third-party session on the shared lab: Zenoh and MessagePack, without `quadctl`."""
    with shared_lab.bare() as session:
        yield session


@pytest.fixture
def hover(shared_lab: Lab, bare: Bare) -> Bare:
    """`bare` with the vehicle at rest at (0, 0, 1), the cage on, the baseline 0, and parameters as launched."""
    shared_lab.put_back()
    return bare
