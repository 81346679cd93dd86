"""Digests of our types, computed: `python -m tests.support.digests` writes schemas/digests.py."""

from pathlib import Path

from quadctl.schemas import digests
from quadctl.schemas.messages import Called
from quadctl.schemas.services import Call
from quadctl.schemas.topics import MESSAGES, SERVICES, get_params, set_params
from quadctl.schemas.typeinfo import schema_hash

FILE = Path(__file__).parents[2] / "schemas" / "digests.py"


def computed() -> dict[str, str]:
    """Return the digest of each type on the wire, by the type's module and name."""
    services = (*SERVICES, get_params(""), set_params(""))
    ends: list[type] = [
        part for service in services for part in (service.request, service.response)
    ]
    types: tuple[type, ...] = (*MESSAGES.values(), Called, Call, *ends)
    return {digests.place(type_): schema_hash(type_) for type_ in types}


def main() -> None:
    """Write the table again, between its brackets."""
    rows = "".join(f'    "{place}": "{found}",\n' for place, found in sorted(computed().items()))
    text = FILE.read_text(encoding="utf-8")
    begin, end = text.index(" = {\n") + len(" = {\n"), text.index("}\n")
    FILE.write_text(text[:begin] + rows + text[end:], encoding="utf-8")


if __name__ == "__main__":
    main()
