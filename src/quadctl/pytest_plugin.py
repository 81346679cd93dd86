"""Fixtures for tests that fly: `quad_run`, a system of the test's own, and `quad`, its vehicle.

    @pytest.mark.quad(params={"dynamics.speed": 0}, processes={"safety": "python my_safety.py"})
    def test_arrives(quad):
        assert quad.goto(1, 2, 1).distance <= 0.5

The mark takes the arguments of `quadctl.launch`. A test that fails prints the ends of its nodes' logs.
"""

from collections.abc import Generator, Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from quadctl.system import Run
    from quadctl.vehicle import Vehicle

_LINES = 20
"""Lines of each log that a failed test prints."""


def pytest_configure(config: pytest.Config) -> None:
    """Declare the mark."""
    config.addinivalue_line(
        "markers",
        "quad(**arguments): arguments of quadctl.launch for the fixtures quad_run and quad",
    )


@pytest.fixture
def quad_run(request: pytest.FixtureRequest) -> "Iterator[Run]":
    """Start a system with the arguments of the test's mark `quad`, and end it after the test."""
    import quadctl

    mark = request.node.get_closest_marker("quad")
    with quadctl.launch(*mark.args, **mark.kwargs) if mark else quadctl.launch() as run:
        yield run


@pytest.fixture
def quad(quad_run: "Run") -> "Vehicle":
    """Return the only vehicle of `quad_run`."""
    return quad_run.vehicle


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the logs to the report of a test that failed while its system ran."""
    report = yield
    run = getattr(item, "funcargs", {}).get("quad_run")
    if run is not None and report.when == "call" and report.failed:
        for name, lines in run.logs().items():
            report.sections.append((f"log of {name}", "\n".join(lines[-_LINES:])))
    return report
