"""Which keys a pattern covers: as Zenoh itself decides it, which enforces it."""

import zenoh
from hypothesis import example, given
from hypothesis import strategies as st

from quadctl.schemas.keyexpr import includes

CHUNKS = st.sampled_from(
    ["uav", "uav7", "pose", "*", "**", "@srv", "@node", "own-a", "own-$*", "$*7", "a$*b", "ab"]
)
EXPRESSIONS = st.lists(CHUNKS, min_size=1, max_size=5).map("/".join)


def canonical(text: str) -> zenoh.KeyExpr:
    return zenoh.KeyExpr.autocanonize(text)


@given(EXPRESSIONS, EXPRESSIONS)
@example("*/**", "**")
@example("uav7/**", "uav7/@srv/goto")
@example("*/@node/own-$*", "uav/@node/own-camera")
@example("**", "uav/@srv/**")
def test_as_zenoh_says(pattern: str, key: str):
    ours, theirs = canonical(pattern), canonical(key)
    assert includes(str(ours), str(theirs)) == ours.includes(theirs)
