"""Command that builds the book: `python -m docs.book [FOLDER]`, as `make docs` does.

Zensical reads a folder with the pages and the files that they link to, laid out as in the checkout,
so that every link works on GitHub and in the book alike. It builds offline, and strictly: a warning,
e.g. about a link that leads nowhere, ends it.
"""

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

ROOT = Path(__file__).parents[1]
PAGES = (
    "README.md",
    "docs/**/*.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
    "benchmarks/README.md",
)
_LINK = re.compile(r"\]\(([^)\s#]+)(?:#[^)\s]*)?\)")


def pages() -> list[Path]:
    """Return the pages of the book, relative to the checkout."""
    return [page.relative_to(ROOT) for each in PAGES for page in sorted(ROOT.glob(each))]


def linked(page: Path) -> Iterator[Path]:
    """Yield the files beside the pages that a page links to, relative to the checkout."""
    for target in _LINK.findall((ROOT / page).read_text(encoding="utf-8")):
        file = (ROOT / page).parent / unquote(target)
        if "://" not in target and file.is_file() and file.suffix != ".md":
            yield file.resolve().relative_to(ROOT)


def lay_out(folder: Path) -> None:
    """Copy the pages and the files that they link to."""
    shutil.rmtree(folder, ignore_errors=True)
    for page in pages():
        for file in (page, *linked(page)):
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / file, folder / file)


def render(work: Path) -> int:
    """Render the pages in a working folder, strictly; return the exit code of Zensical."""
    zensical = str(Path(sys.executable).with_name("zensical"))
    words = ("build", "--strict", "--clean", "--config-file", str(work / "zensical.toml"))
    return subprocess.run([zensical, *words], check=False, cwd=work).returncode


def build(target: Path, work: Path) -> int:
    """Build the book into a folder by way of a working folder; return the exit code of Zensical."""
    lay_out(work / "pages")
    settings = (ROOT / "docs" / "book.toml").read_text(encoding="utf-8")
    (work / "zensical.toml").write_text(settings.replace("SOURCES", str(ROOT / "src")), "utf-8")
    code = render(work)
    if not code:
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(work / "site", target)
    return code


if __name__ == "__main__":
    book = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build" / "book"
    sys.exit(build(book, ROOT / ".cache" / "book"))
