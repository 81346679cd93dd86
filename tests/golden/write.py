"""Write the recorded data anew: `python -m tests.golden.write [NAME...]`.

For a change of the outside that is wanted: the diff of the data then shows it.
"""

import sys
from collections.abc import Callable
from typing import Any

from tests.golden import contract, data, hashes, shapes, traffic
from tests.golden.requests import requests
from tests.support.lab import private_lab


def main() -> None:
    """Write the files that are named, or all of them."""
    for name in sys.argv[1:] or WRITERS:
        data.write(name, WRITERS[name]())
        print(f"data/{name}.json")


def _shapes() -> dict[str, Any]:
    with private_lab() as lab:
        return shapes.gather(lab)


def _hashes() -> dict[str, Any]:
    with private_lab() as lab:
        return hashes.gather(lab)


def _traffic() -> dict[str, Any]:
    with private_lab() as lab:
        return traffic.conversation(lab, list(requests()))


WRITERS: dict[str, Callable[[], dict[str, Any]]] = {
    **contract.DOCUMENTS,
    "hashes": _hashes,
    "shapes": _shapes,
    "traffic": _traffic,
}


if __name__ == "__main__":
    main()
