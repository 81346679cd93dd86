"""Digests of the types on the wire, computed, for schemas/digests.py."""

from pathlib import Path

from tests.golden import product


def computed() -> dict[str, str]:
    """Return the digest of each type whose digest is sent, by the type's module and name."""
    types = set(product.sent_types()) - {product.Error}  # sent only as JSON
    return {product.digests.place(type_): product.schema_hash(type_) for type_ in types}


def write() -> None:
    """Write the table again, between its brackets."""
    rows = "".join(f'    "{place}": "{found}",\n' for place, found in sorted(computed().items()))
    file = Path(product.digests.__file__)
    text = file.read_text(encoding="utf-8")
    begin, end = text.index(" = {\n") + len(" = {\n"), text.index("}\n")
    file.write_text(text[:begin] + rows + text[end:], encoding="utf-8")
