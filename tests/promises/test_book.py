"""The book: built strictly and offline, with every page in its contents; tables made from declarations."""

import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from docs.book import ROOT, build, pages, render
from docs.draw import PAGES, PICTURES, drawn
from tests.golden.data import HOW


def contents(entries: list[dict[str, Any]]) -> Iterator[str]:
    for entry in entries:
        for value in entry.values():
            yield from contents(value) if isinstance(value, list) else [value]


def test_every_page_is_in_the_contents_once():
    settings = tomllib.loads((ROOT / "docs" / "book.toml").read_text("utf-8"))
    named = list(contents(settings["project"]["nav"]))
    assert sorted(named) == sorted(page.as_posix() for page in pages())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_table_is_that_of_the_declarations(page: Path):
    assert drawn(page) == page.read_text("utf-8"), HOW


@pytest.mark.parametrize("picture", PICTURES, ids=lambda picture: picture.name)
def test_a_picture_is_that_of_the_declarations(picture: Path):
    assert PICTURES[picture]() == picture.read_text("utf-8"), HOW


@pytest.mark.thorough
def test_the_book_is_built_without_a_warning_and_names_no_other_site(tmp_path: Path):
    target = tmp_path / "book"
    assert build(target, tmp_path / "work") == 0
    home = (target / "index.html").read_text("utf-8")
    assert "Your own node in an afternoon" in home
    api = (target / "docs/reference/python-api.html").read_text("utf-8")
    for name in ("Vehicle", "goto", "settle", "Refused", "launch"):
        assert name in api
    loaded = [
        (page.name, word)
        for page in target.rglob("*.html")
        for word in page.read_text("utf-8").replace("'", '"').split('"')
        if word.startswith(("http://", "https://")) and word.endswith((".js", ".css", ".woff2"))
    ]
    assert loaded == [], "a page loads from another site"


@pytest.mark.thorough
def test_a_link_that_leads_nowhere_ends_the_build(tmp_path: Path):
    work = tmp_path / "work"
    assert build(tmp_path / "book", work) == 0
    (work / "pages" / "README.md").write_text("# Home\n\n[gone](docs/gone.md)\n", "utf-8")
    assert render(work) != 0
    shutil.rmtree(work)
