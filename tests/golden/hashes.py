"""Hashes of a mission and two campaigns, and a probe of the machine that flew them."""

import hashlib
import math
import struct
from typing import Any

from tests.support.lab import Lab
from tests.support.missions import fly, start

CAMPAIGN = ("campaign", "--flights", 1, "--seconds", 4, "--seed", 3)
FAULTS = (*CAMPAIGN, "--faults", "--wind", 3)
DIGESTS = ("hash", "poses", "transitions", "pressure", "counts")


def gather(lab: Lab) -> dict[str, Any]:
    """Fly two campaigns and a mission in lock-step; return their hashes."""
    campaigns = {
        " ".join(map(str, words)): lab.quadctl(*words, "--json").json["hash"]
        for words in (CAMPAIGN, FAULTS)
    }
    start(lab, "dynamics.speed=0")
    flown = fly(lab)
    return {
        "probe": probe(),
        "fly": {name: flown[name] for name in DIGESTS},
        "campaigns": campaigns,
    }


def probe() -> str:
    """Return a digest of the rounding of this machine's mathematical functions.

    On a machine with another digest, flights may differ in their last bits.
    """
    whole = hashlib.sha256()
    for number in range(1, 10_000):
        x = number / 997
        found = (math.sin(x), math.cos(x), math.exp(-x), math.log(x), math.atan2(x, 3), x**0.37)
        whole.update(struct.pack("<6d", *found))
    return whole.hexdigest()
