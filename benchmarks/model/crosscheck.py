"""Command that compares our flights with rotorpy's and mujoco's, and stores theirs for the tests.

    python -m benchmarks.model.crosscheck [--write]

Each peer flies in a separate environment below .cache, created when first needed. --write stores
their flights in tests/unit/dynamics/data. Exit 1 if one of our flights differs too much.
"""

import argparse
import json
import sys

from benchmarks.model import environments
from benchmarks.model.flown import fly
from benchmarks.model.scenario import FLIGHTS, digest, peer

DATA = environments.ROOT / "tests" / "unit" / "dynamics" / "data"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--write", action="store_true", help="keep the peers' flights")
    write = parser.parse_args().write
    worst = 0
    for name, flight in FLIGHTS.items():
        theirs = json.loads(environments.run(peer(name), f"{peer(name)}_flight", name))
        ours = fly(flight)
        apart = max(
            abs(a - b)
            for mine, its in zip(ours, theirs["states"], strict=True)
            for a, b in zip(mine[:3], its[:3], strict=True)
        )
        holds = apart < flight.metres
        worst |= not holds
        said = "holds" if holds else "MISSED"
        print(f"{name:20} {theirs['version']:8} {apart:.2g} m, bar {flight.metres:g} m: {said}")
        if write:
            kept = {"peer": peer(name), "version": theirs["version"], "parameters": digest(flight)}
            text = json.dumps(kept | {"states": theirs["states"]}, indent=1)
            (DATA / f"{name}.json").write_text(text + "\n", encoding="utf-8")
    return int(worst)


if __name__ == "__main__":
    sys.exit(main())
