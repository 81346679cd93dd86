"""Digests of the types on the wire, computed, for schemas/digests.py."""

from pathlib import Path
from typing import Any

from msgspec import Struct

from tests.golden import contract, data, product, releases


def computed() -> dict[str, str]:
    """Return the digests of each type whose digest is sent, by the type's module and name.

    Those of kept versions that the type follows come after its own.
    """
    now = forms()
    kept = [releases.document(version, "messages") for version in releases.releases()]
    return {product.digests.place(type_): _digests(type_, kept, now) for type_ in sent()}


def forms() -> dict[str, Any]:
    """Describe each type on the wire; encodings are not among that: they follow from the digests."""
    types = product.wire_types().items()
    return data.plain({name: contract.form(type_) for name, type_ in types})


def sent() -> set[type[Struct]]:
    """Return the types that are sent with a digest."""
    return set(product.sent_types()) - {product.Error}  # sent only as JSON


def _digests(type_: type[Struct], kept: list[dict[str, Any]], now: dict[str, Any]) -> str:
    name = type_.__name__
    followed = [each for each in kept if name in each and not broken(type_, each, now)]
    found = [product.schema_hash(type_), *(each[name]["hash"] for each in followed)]
    return ".".join(dict.fromkeys(found))


def broken(type_: type[Struct], kept: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Return why a type does not follow its kept version, or a type inside it."""
    found = releases.broken(type_.__name__, kept, now, sent_alone=True)
    for part in product.parts(type_):
        if part.__name__ in kept:
            found += releases.broken(part.__name__, kept, now, sent_alone=False)
    return found


def all_broken(kept: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Return why a type that is sent does not follow its kept version, of all such types."""
    types = (type_ for type_ in sent() if type_.__name__ in kept)
    return sorted({fault for type_ in types for fault in broken(type_, kept, now)})


def write() -> None:
    """Write the table again, between its brackets."""
    rows = "".join(f'    "{place}": "{found}",\n' for place, found in sorted(computed().items()))
    file = Path(product.digests.__file__)
    text = file.read_text(encoding="utf-8")
    begin, end = text.index(" = {\n") + len(" = {\n"), text.index("}\n")
    file.write_text(text[:begin] + rows + text[end:], encoding="utf-8")
