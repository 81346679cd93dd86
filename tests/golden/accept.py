"""Command that shows what follows from changed declarations, and takes it over: `make accept [WRITE=1]`.

That is recorded data, digests, `quad.toml`, and the tables and pictures of docs/. It never touches the
table of roles in the tests of security, the hashes of flights, or the cases of the rules: these are
there to contradict a change.
"""

import argparse
import difflib
import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from docs import draw
from quadctl.schemas.digests import DIGESTS
from quadctl.services.runtime.params.catalogue import render
from tests.golden import contract, data, digests, releases, shapes
from tests.golden.differences import differences
from tests.support.lab import private_lab

ROOT = Path(__file__).parents[2]
_MOST = 40
"""Differences of a file that are shown."""


def main() -> None:
    """Show what changes, and with --write write it; exit 1 if the contract of a release is broken."""
    parser = argparse.ArgumentParser(description="Take over what follows from the declarations.")
    parser.add_argument("--write", action="store_true")
    write, changed = parser.parse_args().write, 0
    old, new = dict(DIGESTS), digests.computed()
    # All that follows has the new digests.
    DIGESTS.clear()
    DIGESTS.update(new)
    gathers = {**contract.DOCUMENTS, "shapes": _shapes}
    found = {name: data.plain(gather()) for name, gather in gathers.items()}
    for name, lines, accept in _changes(old, found):
        changed += 1
        _show(name, lines)
        if write:
            accept()
    remark = "written" if write else "not written: `make accept WRITE=1` does it"
    print(f"{changed} files change, {remark}" if changed else "nothing changes")
    if broken := [*_broken(found)]:
        _show("this breaks a release's contract (docs/reference/stability.md):", broken)
        raise SystemExit(1)


def _show(head: str, lines: list[str]) -> None:
    print(head)
    print(*(f"    {line}" for line in lines[:_MOST]), sep="\n")
    if len(lines) > _MOST:
        print(f"    .. and {len(lines) - _MOST} more")


def _broken(found: dict[str, Any]) -> Iterator[str]:
    """Yield what a release promised and today's declarations break."""
    for version in releases.releases():
        lines = digests.all_broken(releases.document(version, "messages"), digests.forms())
        for name in set(releases.DOCUMENTS) - {"messages"}:
            lines += releases.missing(version, name, found[name])
        yield from (f"{version}: {line}" for line in lines)


def _changes(
    old: dict[str, str], found: dict[str, Any]
) -> Iterator[tuple[str, list[str], Callable[[], None]]]:
    """Yield each file that changes, with its differences and a function that writes it."""
    if told := differences(dict(sorted(old.items())), dict(sorted(DIGESTS.items()))):
        yield "schemas/digests.py", told, digests.write
    for name, content in found.items():
        if told := differences(data.read(name), content):
            yield f"tests/golden/data/{name}.json", told, partial(data.write, name, content)
    texts = {ROOT / "quad.toml": render()}
    texts |= {page: draw.drawn(page) for page in draw.PAGES}
    texts |= {picture: text() for picture, text in draw.PICTURES.items()}
    for file, text in texts.items():
        before = file.read_text(encoding="utf-8")
        if before != text:
            lines = difflib.unified_diff(before.splitlines(), text.splitlines(), n=0, lineterm="")
            yield (
                os.path.relpath(file, ROOT),
                [line for line in lines if line[:2] not in {"--", "++", "@@"}],
                partial(_write, file, text),
            )


def _write(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8")


def _shapes() -> dict[str, Any]:
    with private_lab() as lab:
        return shapes.gather(lab)


if __name__ == "__main__":
    main()
