"""Links and tables on the pages: a link leads to an existing file of its name, a row belongs to a table."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [
    page
    for pattern in ("*.md", "docs/**/*.md", "benchmarks/*.md", "examples/*.md")
    for page in sorted(ROOT.glob(pattern))
]
LINK = re.compile(r"\[([^\]]*)\]\(([^)\s]+)\)")
TABLE = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)
CODE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
TITLE = re.compile(r"^#+ (.*)$", re.MULTILINE)


def links(page: Path) -> list[tuple[str, str]]:
    found = LINK.findall(page.read_text(encoding="utf-8"))
    return [(text, target) for text, target in found if not target.startswith("http")]


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's titles, as GitHub makes them."""
    titles = TITLE.findall(page.read_text(encoding="utf-8"))
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_leads_to_a_file_of_its_name(page: Path):
    for text, target in links(page):
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), target
        assert not anchor or anchor in anchors(file), target
        if text.endswith(".py"):
            assert target.endswith(text), f"{text} names another file than {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_no_row_of_a_table_stands_apart(page: Path):
    for table in TABLE.findall(CODE.sub("", page.read_text(encoding="utf-8"))):
        assert re.match(r"\|.*\n\|[-:| ]+\|\n", table), f"no table begins with {table}"


def test_the_readme_is_short_and_links_to_every_page():
    readme = ROOT / "README.md"
    assert readme.stat().st_size <= 8000
    linked = {(ROOT / target.partition("#")[0]).resolve() for _, target in links(readme)}
    pages = {page for page in PAGES if page.parent != ROOT / "examples"} - {readme}
    assert pages - linked == set()


def test_the_pages_have_links():
    assert sum(len(links(page)) for page in PAGES) > 100
