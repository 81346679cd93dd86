"""Fixtures of machines in network namespaces, shared by many tests."""

import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from tests.support.classroom import COUNT, HERE, Room, classroom
from tests.support.network_field import Field, field
from tests.support.proofs import Proofs
from tests.support.running import eventually


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if {"net", "room"} & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.needs("ip", "namespaces"))


@pytest.fixture(scope="module")
def net() -> Iterator[Field]:
    with field() as made:
        yield made


@pytest.fixture(scope="module")
def room(proofs: Proofs) -> Iterator[Room]:
    """Classroom of thirty running machines, with poses received from all."""
    with classroom(COUNT) as made, ExitStack() as held:
        made.open()
        began = time.monotonic()
        made.start()
        came = time.monotonic()
        names = [student.name for student in made.students]
        eventually(lambda: list(made.listed()) == names)
        seen = time.monotonic()
        made.listen(held)
        made.rests()
        proofs.add(
            f"{HERE}: until the teacher's `fleet list` has all",
            f"{seen - came:.1f} s after the last was up; all up in {came - began:.0f} s on one machine's"
            " two cores",
            "all",
        )
        yield made
