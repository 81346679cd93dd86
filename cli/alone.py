"""Options that may stand without a value, which neither parser knows: they are given one, empty."""

_ENDINGS = {"--record": ".mcap"}
"""What the word after such an option ends with, where it is the option's value."""


def given(words: list[str]) -> list[str]:
    """The line with `--record` as `--record=`, and `--record x.mcap` as `--record=x.mcap`."""
    line: list[str] = []
    for word in words:
        before = line[-1] if line else ""
        if before.endswith("=") and word.endswith(_ENDINGS.get(before[:-1], "\0")):
            line[-1] += word
        else:
            line.append(f"{word}=" if word in _ENDINGS else word)
    return line
