"""Which keys a Zenoh key expression stands for, decided without Zenoh."""

from functools import cache


def includes(pattern: str, key: str) -> bool:
    """Whether every key that `key`, itself perhaps an expression, stands for fits the pattern.

    `*` is one chunk, `**` any number of them, `$*` any part of one. None of these stands for a chunk
    that begins with `@`: such a one is matched by itself alone.
    """
    return _chunks(tuple(pattern.split("/")), tuple(key.split("/")))


@cache
def _chunks(pattern: tuple[str, ...], key: tuple[str, ...]) -> bool:
    if not pattern:
        return not key
    first, rest = pattern[0], pattern[1:]
    if first == "**":
        # Of no chunk, or of one more.
        more = bool(key) and not key[0].startswith("@") and _chunks(pattern, key[1:])
        return more or _chunks(rest, key)
    if not key:
        return False
    return _chunk(first, key[0]) and _chunks(rest, key[1:])


def _chunk(pattern: str, chunk: str) -> bool:
    if pattern == chunk:
        return True
    if chunk == "**" or chunk.startswith("@") or pattern.startswith("@"):
        return False
    if pattern == "*":
        return True
    if chunk == "*":
        return pattern == "$*"
    return "$*" in pattern and _parts(pattern, chunk)


@cache
def _parts(pattern: str, chunk: str) -> bool:
    """Character by character; `$*` stands for any of them, a `$*` of the chunk for itself too."""
    if not pattern:
        return not chunk
    if pattern.startswith("$*"):
        if _parts(pattern[2:], chunk):
            return True
        taken = 2 if chunk.startswith("$*") else 1
        return bool(chunk) and _parts(pattern, chunk[taken:])
    if not chunk or chunk.startswith("$*"):
        return False
    return pattern[0] == chunk[0] and _parts(pattern[1:], chunk[1:])
