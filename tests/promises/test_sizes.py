"""Sizes of the texts that people read: each thing is said once, in a page that can be read to its end."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
RELEASE, PROMISES, WRITTEN = 8_000, 20_000, 180_000
"""Bytes at most: of one release in CHANGELOG.md, of docs/promises.md, of all that is written by hand."""
MADE = re.compile(r"<!-- (\w+) -->\n.*?<!-- /\1 -->", re.DOTALL)
"""Part of a page that a machine writes: `python -m docs.draw`, `make prove`."""


def written(page: Path) -> int:
    """Return the bytes of a page that are written by hand, code and output included."""
    return len(MADE.sub("", page.read_text(encoding="utf-8")).encode())


def test_a_release_in_the_changelog_is_short():
    releases = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")
    sizes = {release.partition("\n")[0]: len(release.encode()) for release in releases}
    assert {name: size for name, size in sizes.items() if size > RELEASE} == {}


def test_the_promises_are_short():
    assert (ROOT / "docs" / "promises.md").stat().st_size <= PROMISES


def test_the_pages_written_by_hand_are_short_together():
    pages = [*(ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "SECURITY"))]
    sizes = {page: written(page) for page in [*pages, *sorted((ROOT / "docs").rglob("*.md"))]}
    longest = sorted(sizes, key=lambda page: -sizes[page])[:5]
    assert sum(sizes.values()) <= WRITTEN, [f"{sizes[page]} {page.name}" for page in longest]


def test_only_what_is_between_marks_is_made(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text(
        "one\n<!-- table -->\n| a |\n<!-- /table -->\ntwo\n<!-- open -->\nthree", "utf-8"
    )
    assert written(page) == len("one\n\ntwo\n<!-- open -->\nthree")
