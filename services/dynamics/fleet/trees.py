"""Values of several numbers: tuples of tuples of them, as the model's functions take and return."""

from typing import Any

Tree = Any
"""A leaf, or a tuple of trees."""


def flat(tree: Tree) -> list[Any]:
    """The leaves, in order."""
    if isinstance(tree, tuple):
        return [leaf for part in tree for leaf in flat(part)]
    return [tree]
