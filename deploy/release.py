"""Release of the version in pyproject.toml, for `make release`: built, compared, checked and installed.

    python -m deploy.release --uv REQUIREMENT [--rehearse] [--tagged] [--machines SUITE...]

It signs and uploads nothing: it leaves wheel and sdist in dist/, and prints their hashes and the commands by
which a person publishes them. It refuses before it builds, with a line for each reason. A rehearsal leaves
open what only a person can decide: the addresses of the project, and the date.
"""

import argparse
import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"
TWINE = "twine==7.0.0"
PLACEHOLDER = "quadctl.invalid"
"""Host in place of one that the project has not got yet: nobody can have a name below .invalid (RFC 6761)."""
ADDRESSED = (".md", ".toml", ".cff", ".yml")
"""Endings of the files that may hold an address of the project."""
FIRST_HEADING = re.compile(r"^## \[(.+?)\](?: - (.+))?$", re.MULTILINE)
DATE = re.compile(r"\d{4}-\d\d-\d\d")
MAIL = re.compile(r"[\w.+-]+@[\w.-]+\w")
UMASKS = {"first": 0o022, "in another folder": 0o077}
"""Umask of each build, by its name; the hashes must not depend on it, nor on the folder."""


class Refused(Exception):
    """Reasons to release nothing, a line for each."""


def main() -> int:
    """Release, or rehearse it; return the exit code."""
    parser = argparse.ArgumentParser(description="Build, check and install a release.")
    parser.add_argument("--uv", required=True, help="requirement of uv, which installs it, too")
    parser.add_argument("--rehearse", action="store_true", help="leave addresses and date open")
    parser.add_argument("--tagged", action="store_true", help="this commit has the tag already")
    parser.add_argument("--machines", nargs="*", default=[], help="bare Debians to install it on")
    asked = parser.parse_args()
    try:
        texts = tracked()
    except (OSError, subprocess.CalledProcessError) as error:
        return refused([f"{ROOT} is no checkout of git, or git is missing: {error}"])
    version = versions(texts)["pyproject.toml"]
    reasons = [*differing(texts), *unfit(f"v{version}", tagged=asked.tagged)]
    open_questions = list(undecided(texts))
    if not asked.rehearse:
        reasons += open_questions
    if reasons:
        return refused(reasons)
    try:
        wheel, sdist = built()
        checked(wheel, sdist)
        installed(wheel, asked.uv, asked.machines)
    except Refused as refusal:
        return refused(str(refusal).splitlines())
    print(*(f"{digest(file.read_bytes())}  {file.name}" for file in (wheel, sdist)), sep="\n")
    if asked.rehearse:
        print(
            "This was a rehearsal. A release is refused for",
            *(open_questions or ["nothing"]),
            sep="\n  ",
        )
    else:
        print("A person publishes it by one of these:", *by_hand(version, wheel, sdist), sep="\n  ")
    return 0


def refused(reasons: list[str]) -> int:
    """Print the reasons to release nothing; return the exit code."""
    print(*(f"refused: {reason}" for reason in reasons), sep="\n")
    return 1


# What the files say


def versions(texts: Mapping[str, str]) -> dict[str, str]:
    """Return the version that each file declares; the changelog does by its first heading."""
    heading = FIRST_HEADING.search(texts.get("CHANGELOG.md", ""))
    return {
        "pyproject.toml": str(project(texts)["version"]),
        "CITATION.cff": str(citation(texts).get("version", "none")),
        "CHANGELOG.md": heading[1] if heading else "none",
    }


def differing(texts: Mapping[str, str]) -> Iterator[str]:
    """Yield a reason if the files declare different versions."""
    declared = versions(texts)
    if len(set(declared.values())) > 1:
        yield "the versions differ: " + ", ".join(" ".join(each) for each in declared.items())


def undecided(texts: Mapping[str, str]) -> Iterator[str]:
    """Yield the reasons that only a person can remove: addresses of the project, and the date."""
    if found := placeholders(texts):
        yield f"{len(found)} addresses are placeholders ({PLACEHOLDER}): {', '.join(found)}"
    source = project(texts).get("urls", {}).get("Source", "none")
    if source == "none" or source != citation(texts).get("repository-code"):
        yield f"pyproject.toml has the address {source} (Source), and CITATION.cff another or none"
    if not MAIL.search(texts.get("SECURITY.md", "")):
        yield "SECURITY.md has no mail address"
    heading = FIRST_HEADING.search(texts.get("CHANGELOG.md", ""))
    date = (heading and heading[2]) or "none"
    if not DATE.fullmatch(date):
        yield f"the date of the release in CHANGELOG.md is {date}: write YEAR-MONTH-DAY, there and in CITATION.cff"
    elif date != str(citation(texts).get("date-released")):
        yield f"the release is of {date} in CHANGELOG.md, and date-released of CITATION.cff is another"


def placeholders(texts: Mapping[str, str]) -> list[str]:
    """Return file and line of each address that is a placeholder."""
    return [
        f"{name}:{number}"
        for name, text in texts.items()
        for number, line in enumerate(text.splitlines(), 1)
        if PLACEHOLDER in line
    ]


def project(texts: Mapping[str, str]) -> dict[str, Any]:
    """Return the table [project] of pyproject.toml."""
    table: dict[str, Any] = tomllib.loads(texts["pyproject.toml"])["project"]
    return table


def citation(texts: Mapping[str, str]) -> dict[str, Any]:
    """Return the fields of CITATION.cff."""
    return yaml.safe_load(texts.get("CITATION.cff", "")) or {}


def differences(one: bytes, other: bytes) -> list[str]:
    """Return the members by which two wheels, or two sdists, differ; their order and times, if no contents do."""
    if one == other:
        return []
    here, there = contents(one), contents(other)
    names = [name for name in sorted({*here, *there}) if here.get(name) != there.get(name)]
    return names or ["order, times or modes of the members"]


def contents(archive: bytes) -> dict[str, bytes]:
    """Return the contents of the files in a wheel or an sdist, by their names."""
    if zipfile.is_zipfile(io.BytesIO(archive)):
        with zipfile.ZipFile(io.BytesIO(archive)) as wheel:
            return {name: wheel.read(name) for name in wheel.namelist()}
    with tarfile.open(fileobj=io.BytesIO(archive)) as sdist:
        files = {member.name: sdist.extractfile(member) for member in sdist}
        return {name: file.read() if file else b"" for name, file in files.items()}


def digest(data: bytes) -> str:
    """Return the SHA-256 of data, as sha256sum prints it."""
    return hashlib.sha256(data).hexdigest()


def by_hand(version: str, wheel: Path, sdist: Path) -> list[str]:
    """Return the commands by which a person publishes a release: on a forge with workflows, or without."""
    tag = f"git tag --sign v{version} --message 'quadctl {version}'"
    files = " ".join(file.relative_to(ROOT).as_posix() for file in (wheel, sdist))
    return [
        f"{tag} && git push origin v{version}    # release.yml builds the same files",
        f"twine upload {files}",
    ]


# What git has


def tracked() -> dict[str, str]:
    """Return the files that may hold an address, by their names."""
    names = git("ls-files", "-z").split("\0")
    found = [name for name in names if name.endswith(ADDRESSED) and (ROOT / name).is_file()]
    return {name: (ROOT / name).read_text("utf-8") for name in found}


def unfit(tag: str, *, tagged: bool) -> Iterator[str]:
    """Yield reasons for which the checkout cannot be released: changes without a commit, and the tag."""
    if changed := git("status", "--porcelain").splitlines():
        yield f"{len(changed)} files differ from the commit, first {changed[0][3:]}: commit or remove them"
    at = git("for-each-ref", "--format=%(objectname)%(*objectname)", f"refs/tags/{tag}").strip()
    if tagged and not at.endswith(git("rev-parse", "HEAD").strip()):
        yield f"the tag {tag} is not at this commit"
    if at and not tagged:
        yield f"the tag {tag} exists already: give the next release another version"


def git(*words: str) -> str:
    """Return the output of git in the checkout."""
    # The checkout may belong to the user who called sudo.
    command = ("git", "-c", "safe.directory=*", *words)
    return subprocess.run(command, check=True, cwd=ROOT, capture_output=True, text=True).stdout


# What is built


def built() -> tuple[Path, Path]:
    """Build the commit twice, and a wheel of the sdist; return wheel and sdist in dist/, or raise Refused."""
    with tempfile.TemporaryDirectory() as scratch:
        made: dict[str, list[Path]] = {}
        for name, umask in UMASKS.items():
            source = Path(scratch, name, "source")
            git("clone", "--quiet", "--depth", "1", ROOT.as_uri(), str(source))
            made[name] = build(
                source, Path(scratch, name, "dist"), "--wheel", "--sdist", umask=umask
            )
        sdist = next(file for file in made["first"] if file.suffix == ".gz")
        # Python 3.12 and 3.13 warn without a filter, 3.11.2 has none; the archive is our own.
        safely: dict[str, Any] = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}
        shutil.unpack_archive(sdist, Path(scratch, "sdist"), **safely)
        [source] = Path(scratch, "sdist").iterdir()
        made["from the sdist"] = build(source, Path(scratch, "again"), "--wheel")
        for name, files in made.items():
            for one, other in zip(made["first"], files, strict=False):
                if told := differences(one.read_bytes(), other.read_bytes()):
                    raise Refused(f"{one.name}, built {name}, differs in {len(told)}: {told[0]}")
        shutil.rmtree(DIST, ignore_errors=True)
        shutil.copytree(Path(scratch, "first", "dist"), DIST)
    wheel, sdist = (DIST / file.name for file in made["first"])
    print(
        f"{wheel.name} and {sdist.name}: built twice, and the wheel from the sdist, with equal hashes",
        flush=True,
    )
    return wheel, sdist


def build(source: Path, target: Path, *kinds: str, umask: int = -1) -> list[Path]:
    """Build a source folder by this environment's backend, which a lock pins; return the files, wheel first."""
    command = ("-m", "build", "--no-isolation", *kinds, "--outdir", str(target), str(source))
    # hatchling takes its own constant for the time of all members, unless this names another.
    step(sys.executable, *command, umask=umask, without="SOURCE_DATE_EPOCH")
    return sorted(target.iterdir(), key=lambda file: file.suffix != ".whl")


def checked(*files: Path) -> None:
    """Check wheel and sdist by check-wheel-contents and twine; raise Refused."""
    step(sys.executable, "-m", "check_wheel_contents", str(files[0]))
    tools = ROOT / ".cache" / "release"
    step(sys.executable, "-m", "venv", "--clear", str(tools))
    step(str(tools / "bin/python"), "-m", "pip", "install", "--quiet", TWINE)
    step(str(tools / "bin/python"), "-m", "twine", "check", "--strict", *map(str, files))
    print("check-wheel-contents and twine check --strict: ok", flush=True)


def installed(wheel: Path, uv: str, machines: list[str]) -> None:
    """Install the wheel in fresh environments, here and on bare machines; raise Refused."""
    here = ("deploy/installed.py", str(wheel), uv)
    there = ("tests/machines.py", "--wheel", str(wheel), "--uv", uv, *machines)
    for command in (here, there) if machines else (here,):
        if subprocess.run([sys.executable, *command], check=False, cwd=ROOT).returncode:
            raise Refused("the wheel does not work where it was installed, for the reason above")


def step(*command: str, umask: int = -1, without: str = "") -> None:
    """Run a command silently; raise Refused with the end of its output if it fails."""
    variables = {name: value for name, value in os.environ.items() if name != without}
    done = subprocess.run(
        command, check=False, cwd=ROOT, env=variables, umask=umask,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    if done.returncode:
        raise Refused(
            f"{' '.join(command)} exits with {done.returncode}\n{done.stdout[-2000:].strip()}"
        )


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("interrupted: nothing is released")
