"""Write the recorded data again: `python -m tests.golden.write [NAME...]`.

Run it after an intended change of the contract; the diff of the data then shows the change.
"""

import sys
from collections.abc import Callable
from typing import Any

from tests.golden import contract, data, hashes, shapes, traffic
from tests.golden.requests import requests
from tests.support.lab import private_lab


def main() -> None:
    """Write the named files, or all files."""
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
