"""How a live name may be written so that it goes on what was begun, as ROS users do too. Pure.

Spellings that do not go on it are left out by who asks for them.
"""

from collections.abc import Iterator

from schemas.keyexpr import Offer
from schemas.topics import SERVICES, TOPICS

_PARAMETERS = ("GetParams", "SetParams")


def topic(key: str, begun: str, vehicle: str) -> Iterator[str]:
    """By its name where it is a topic of ours: a name of anybody else's would be taken for a key."""
    name = key.removeprefix(f"{vehicle}/")
    ours = name != key and any(name == topic.name for topic in TOPICS)
    return _spellings(key, name if ours else "", begun)


def service(offer: Offer, begun: str, vehicle: str) -> Iterator[str]:
    """By its name, its full key, or one of ours as ROS has it: `/uav/goto`."""
    own, _, rest = offer.key.partition("/")
    key, named = offer.key, rest == f"@srv/{offer.name}"
    ours = offer.type in _PARAMETERS or any(offer.name == known.name for known in SERVICES)
    if named and ours and begun.startswith("/") and "@" not in begun:
        key = f"{own}/{offer.name}"
    return _spellings(key, offer.name if named and own == vehicle else "", begun)


def node(name: str, begun: str, vehicle: str) -> Iterator[str]:
    """By its name, also behind its vehicle's."""
    return _spellings(f"{vehicle}/{name}", name, begun)


def parameter(name: str, begun: str, vehicle: str) -> Iterator[str]:
    """By its dotted name, or with slashes, also behind its vehicle's name."""
    between = "/" if "/" in begun else "."
    name = name.replace(".", between)
    return _spellings(f"{vehicle}{between}{name}", name, begun)


def setting(name: str, begun: str) -> Iterator[str]:
    """A parameter of the file, which knows of no vehicle."""
    slash = "/" if begun.startswith("/") else ""
    yield f"{slash}{name.replace('.', '/' if '/' in begun else '.')}"


def _spellings(key: str, name: str, begun: str) -> Iterator[str]:
    """The name, where there is one; the key only once something of it may have been begun."""
    slash = "/" if begun.startswith("/") else ""
    if name:
        yield f"{slash}{name}"
    if not name or begun.strip("/"):
        yield f"{slash}{key}"
