"""Values of several numbers: tuples of tuples of them, as the model's functions take and return."""

from collections.abc import Callable
from typing import Any

Tree = Any
"""A leaf, or a tuple of trees."""


def flat(tree: Tree) -> list[Any]:
    """The leaves, in order."""
    if isinstance(tree, tuple):
        return [leaf for part in tree for leaf in flat(part)]
    return [tree]


def mapped(change: Callable[..., Any], tree: Tree, *others: Tree) -> Tree:
    """The same of what `change` makes of each leaf, and of those of other trees at its place."""
    if isinstance(tree, tuple):
        return tuple(mapped(change, *parts) for parts in zip(tree, *others, strict=True))
    return change(tree, *others)
