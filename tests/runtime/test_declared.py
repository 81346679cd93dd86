"""What is said of every parameter, walked once for the file and for `param describe`."""

import msgspec
import pytest

from schemas.describe import bounds_text
from schemas.params import FIXED_AT_LAUNCH, Params
from services.runtime.settings import declared
from services.runtime.settings.named import flatten


def test_every_leaf_is_there_in_the_files_order_with_its_default():
    defaults = dict(flatten(msgspec.to_builtins(Params())))
    found = {name: leaf.default for name, leaf in declared.leaves().items()}
    assert found == defaults
    sections = [name.rpartition(".")[0] for name in found]
    assert sections.index("safety") < sections.index("dynamics") < sections.index("supervise")


def test_every_leaf_has_a_meaning_and_one_in_a_described_table_has_that_ones():
    leaves = declared.leaves()
    assert all(leaf.about for leaf in leaves.values())
    z = leaves["safety.virtual_cage.z"]
    assert (z.unit, bounds_text(z.type)) == ("m", "[0.2, 10000]")
    assert z.about == declared.tables()["safety.virtual_cage"]


def test_every_table_has_a_meaning():
    tables = {name.rpartition(".")[0] for name in declared.leaves()} - {""}
    assert tables <= set(declared.tables())
    assert all(declared.tables().values())


@pytest.mark.parametrize(
    "name", [*sorted(FIXED_AT_LAUNCH), "supervise.answer_timeout", "processes.x"]
)
def test_what_cannot_be_set(name: str):
    assert declared.fixed_at_launch(name)
    assert not declared.fixed_at_launch("safety.takeoff")
