"""rostopic's `-1`, which is `--once` where it is no value of the message. Pure."""

from cli.declare import is_number
from cli.values import is_data, is_pairs, is_type, without_type

_ONCE = "-1"


def without_once(words: list[str], fields: int | None, own: str = "") -> tuple[list[str], bool]:
    """The words of a message without a `-1` at either end of it, and whether there was one.

    `fields` is how many the topic's type `own` has, None where that is not known.
    """
    for end, rest in ((words[-1:], words[:-1]), (words[:1], words[1:])):
        if end == [_ONCE] and rest and not _is_value(rest, fields, own):
            return rest, True
    return words, False


def _is_value(rest: list[str], fields: int | None, own: str) -> bool:
    """Whether a -1 is one value more beside the rest of a message."""
    if len(rest) == 1 and is_type(rest[0], own):
        return True
    values = without_type(rest, own)
    if is_data(values) or is_pairs(values):
        return False
    # A row of known length has room for it or not; another one is a row of numbers.
    return len(values) < fields if fields is not None else all(map(is_number, values))
