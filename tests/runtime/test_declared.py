"""What is said of every parameter, walked once for the file and for `param describe`."""

import msgspec
import pytest

from quadctl.schemas.params import FIXED_AT_LAUNCH, Params
from quadctl.schemas.typeinfo import bounds_text
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.names import flatten


def test_every_leaf_is_there_in_the_files_order_with_its_default():
    defaults = dict(flatten(msgspec.to_builtins(Params())))
    found = {name: leaf.default for name, leaf in catalogue.leaves().items()}
    assert found == defaults
    sections = [name.rpartition(".")[0] for name in found]
    assert sections.index("safety") < sections.index("dynamics") < sections.index("supervise")


def test_every_leaf_has_a_meaning_and_one_in_a_described_table_has_that_ones():
    leaves = catalogue.leaves()
    assert all(leaf.about for leaf in leaves.values())
    z = leaves["safety.virtual_cage.z"]
    assert (z.unit, bounds_text(z.type)) == ("m", "[0.2, 10000]")
    assert z.about == catalogue.tables()["safety.virtual_cage"]


def test_every_table_has_a_meaning():
    tables = {name.rpartition(".")[0] for name in catalogue.leaves()} - {""}
    assert tables <= set(catalogue.tables())
    assert all(catalogue.tables().values())


@pytest.mark.parametrize(
    "name", [*sorted(FIXED_AT_LAUNCH), "supervise.answer_timeout", "processes.x"]
)
def test_what_cannot_be_set(name: str):
    assert catalogue.fixed_at_launch(name)
    assert not catalogue.fixed_at_launch("safety.takeoff")
