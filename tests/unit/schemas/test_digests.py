"""Table of the types' digests."""

from quadctl.schemas.digests import DIGESTS
from tests.golden.data import HOW
from tests.golden.digests import computed


def test_the_table_has_the_digest_of_each_type_on_the_wire():
    assert computed() == DIGESTS, HOW
