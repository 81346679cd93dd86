"""Command that writes recorded data again: `python -m tests.golden.write NAME...`.

Run it after an intended change; the diff of the data then shows the change. Check those of a
recording with `quadctl plot`.
"""

import argparse
from collections.abc import Callable
from functools import partial
from typing import Any

from tests.golden import contract, data, digests, hashes, shapes, traffic
from tests.golden.requests import requests
from tests.recording import recordings
from tests.support.lab import private_lab


def main() -> None:
    """Write the named files."""
    parser = argparse.ArgumentParser(description="Write recorded data again.")
    parser.add_argument("names", nargs="+", choices=WRITERS)
    for name in parser.parse_args().names:
        WRITERS[name]()
        print(f"{name} is written")


def _document(name: str, gather: Callable[[], dict[str, Any]]) -> None:
    data.write(name, gather())


def _shapes() -> dict[str, Any]:
    with private_lab() as lab:
        return shapes.gather(lab)


def _hashes() -> dict[str, Any]:
    with private_lab() as lab:
        return hashes.gather(lab)


def _traffic() -> dict[str, Any]:
    with private_lab() as lab:
        return traffic.conversation(lab, list(requests()))


_DOCUMENTS = {**contract.DOCUMENTS, "hashes": _hashes, "shapes": _shapes, "traffic": _traffic}
WRITERS: dict[str, Callable[[], None]] = {
    **{name: partial(_document, name, gather) for name, gather in _DOCUMENTS.items()},
    **{name: partial(recordings.write, name) for name in recordings.SETTINGS},
    "digests": digests.write,
}
"""Function that writes the file of each name."""


if __name__ == "__main__":
    main()
