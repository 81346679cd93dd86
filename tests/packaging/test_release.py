"""What `make release` refuses, compares and tries, on files and commits made for it."""

import io
import tarfile
import zipfile
from pathlib import Path

import pytest

from deploy import installed, release

SOURCE = "https://forge.example/quadctl"
READY = {
    "pyproject.toml": f'[project]\nversion = "1.0.0"\nurls = {{Source = "{SOURCE}"}}\n',
    "CITATION.cff": f"version: 1.0.0\nrepository-code: {SOURCE}\ndate-released: 2027-01-31\n",
    "CHANGELOG.md": "# Changelog\n\n## [1.0.0] - 2027-01-31\n\n## [0.9.0] - 2026-01-31\n",
    "SECURITY.md": "Write to security@forge.example.\n",
}


def reasons(**changed: str) -> list[str]:
    """Return the reasons to refuse files, of which some have other texts; `_` stands for a dot."""
    texts = READY | {name.replace("_", "."): text for name, text in changed.items()}
    return [*release.differing(texts), *release.undecided(texts)]


def test_files_that_agree_are_released():
    assert reasons() == []


@pytest.mark.parametrize(
    ("file", "before", "after", "said"),
    [
        ("pyproject.toml", "1.0.0", "1.0.1", "pyproject.toml 1.0.1, CITATION.cff 1.0.0"),
        ("CITATION.cff", "1.0.0", "0.9.0", "CITATION.cff 0.9.0"),
        ("CHANGELOG.md", "## [1.0.0] - 2027-01-31\n", "", "CHANGELOG.md 0.9.0"),
        ("CHANGELOG.md", "[1.0.0] - 2027-01-31", "[Unreleased]", "CHANGELOG.md Unreleased"),
        ("CHANGELOG.md", "## ", "", "CHANGELOG.md none"),
        ("CHANGELOG.md", "2027-01-31", "unreleased", "in CHANGELOG.md is unreleased"),
        ("CHANGELOG.md", " - 2027-01-31", "", "in CHANGELOG.md is none"),
        ("CHANGELOG.md", "2027-01-31", "2027-02-01", "date-released of CITATION.cff is another"),
        ("CITATION.cff", "date-released: 2027-01-31\n", "", "date-released of CITATION.cff"),
        ("CITATION.cff", SOURCE, f"{SOURCE}s", "CITATION.cff another or none"),
        ("pyproject.toml", "Source", "Other", "the address none (Source)"),
        ("SECURITY.md", "@", " at ", "SECURITY.md has no mail address"),
        ("SECURITY.md", "forge.example", release.PLACEHOLDER, "1 addresses are placeholders"),
        ("CITATION.cff", "version", f"# {release.PLACEHOLDER}\nversion", ": CITATION.cff:1"),
    ],
)
def test_a_line_says_what_is_refused(file: str, before: str, after: str, said: str):
    assert before in READY[file]
    text = READY[file].replace(before, after)
    found = reasons(**{file.replace(".", "_"): text})
    assert any(said in reason for reason in found), found
    assert all("\n" not in reason for reason in found)


def test_all_files_with_addresses_are_searched():
    texts = release.tracked()
    assert {*READY, "README.md", ".github/ISSUE_TEMPLATE/config.yml"} <= set(texts)
    assert all(
        (release.ROOT / place.rpartition(":")[0]).exists() for place in release.placeholders(texts)
    )


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a repository with a commit, in place of ours."""
    monkeypatch.setattr(release, "ROOT", tmp_path)
    release.git("init", "--quiet")
    (tmp_path / "a").write_text("a")
    release.git("add", "a")
    commit()
    return tmp_path


def commit() -> None:
    who = ("-c", "user.name=test", "-c", "user.email=test@localhost")
    release.git(*who, "commit", "--quiet", "--allow-empty", "--message", "text")


def test_a_commit_without_changes_and_tag_is_fit(checkout: Path):
    assert [*release.unfit("v1.0.0", tagged=False)] == []
    release.git("tag", "v0.9.0")
    assert [*release.unfit("v1.0.0", tagged=False)] == []


def test_a_changed_or_a_new_file_is_refused(checkout: Path):
    (checkout / "a").write_text("b")
    assert "1 files differ from the commit, first a:" in next(release.unfit("v1.0.0", tagged=False))
    release.git("checkout", "a")
    (checkout / "new").touch()
    assert "first new:" in next(release.unfit("v1.0.0", tagged=False))


@pytest.mark.parametrize("words", [(), ("--annotate", "--message=text")])
def test_a_tag_is_refused_unless_a_workflow_stands_on_it(checkout: Path, words: tuple[str, ...]):
    assert [*release.unfit("v1.0.0", tagged=True)] == ["the tag v1.0.0 is not at this commit"]
    who = ("-c", "user.name=test", "-c", "user.email=test@localhost")
    release.git(*who, "tag", *words, "v1.0.0")
    assert "exists already" in next(release.unfit("v1.0.0", tagged=False))
    assert [*release.unfit("v1.0.0", tagged=True)] == []
    commit()
    assert [*release.unfit("v1.0.0", tagged=True)] == ["the tag v1.0.0 is not at this commit"]


def wheel(files: dict[str, str], *, year: int = 2020) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, text in files.items():
            archive.writestr(zipfile.ZipInfo(name, (year, 2, 2, 0, 0, 0)), text)
    return out.getvalue()


def sdist(files: dict[str, str], *, year: int = 2020) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:gz") as archive:
        for name, text in files.items():
            member = tarfile.TarInfo(name)
            member.size, member.mtime = len(text), year
            archive.addfile(member, io.BytesIO(text.encode()))
    return out.getvalue()


@pytest.mark.parametrize("archive", [wheel, sdist])
def test_archives_differ_by_their_contents_or_by_the_rest(archive):
    one = archive({"a": "1", "b": "2"})
    assert release.differences(one, bytes(one)) == []
    assert release.differences(one, archive({"a": "1", "b": "3", "c": "4"})) == ["b", "c"]
    assert release.differences(one, archive({"a": "1"})) == ["b"]
    for other in ({"b": "2", "a": "1"}, {"a": "1", "b": "2"}):
        told = release.differences(one, archive(other, year=2021))
        assert told == ["order, times or modes of the members"]


def test_a_build_that_depends_on_its_umask_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def build(source: Path, target: Path, *kinds: str, umask: int = -1) -> list[Path]:
        files = [target / "q-1-py3-none-any.whl", target / "q-1.tar.gz"][: len(kinds)]
        target.mkdir(parents=True)
        files[0].write_bytes(wheel({"mode": f"{umask if broken else 0}"}))
        files[-1].write_bytes(sdist({"q-1/a": "1"}) if len(kinds) == 2 else files[0].read_bytes())
        return files

    monkeypatch.setattr(release, "build", build)
    monkeypatch.setattr(release, "git", lambda *words: "")
    monkeypatch.setattr(release, "DIST", tmp_path / "dist")
    broken = False
    assert [file.parent for file in release.built()] == [tmp_path / "dist"] * 2
    broken = True
    with pytest.raises(release.Refused, match=r"built in another folder, differs in 1: mode"):
        release.built()


def test_a_person_gets_the_commands_to_publish():
    files = [release.DIST / "q-1.0.0-py3-none-any.whl", release.DIST / "q-1.0.0.tar.gz"]
    tag, upload = release.by_hand("1.0.0", *files)
    assert tag.startswith("git tag --sign v1.0.0")
    assert upload == "twine upload dist/q-1.0.0-py3-none-any.whl dist/q-1.0.0.tar.gz"


def test_the_wheel_is_installed_without_with_each_and_with_all_extras(tmp_path: Path):
    text = "Metadata-Version: 2.4\nName: q\nVersion: 1\nProvides-Extra: a\nProvides-Extra: b\n"
    file = tmp_path / "q-1-py3-none-any.whl"
    file.write_bytes(wheel({"q-1.dist-info/METADATA": text}))
    name, version, extras = installed.metadata(file)
    assert (name, version, extras) == ("q", "1", ["a", "b"])
    asked = [installed.requirement(name, chosen, file) for chosen in installed.selections(extras)]
    assert asked == [f"q{chosen} @ {file.as_uri()}" for chosen in ("", "[a]", "[b]", "[a,b]")]


def test_an_extra_without_a_trial_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = tmp_path / "q-1-py3-none-any.whl"
    file.write_bytes(
        wheel({"q-1.dist-info/METADATA": "Name: q\nVersion: 1\nProvides-Extra: new\n"})
    )
    assert installed.main(file, "uv") == 1
    assert "no trial of the extra new" in capsys.readouterr().out


def test_a_step_that_fails_has_its_reason():
    with pytest.raises(installed.Failed, match="exits with 2\nno such thing"):
        installed.run("sh", "-c", "echo no such thing >&2; exit 2")
    with pytest.raises(installed.Failed, match="'arrived' is not in the output"):
        installed.expect("arrived", "echo", "accepted")
    with pytest.raises(release.Refused, match="exits with 2\nno such thing"):
        release.step("sh", "-c", "echo no such thing; exit 2")


def test_a_bridge_that_is_not_ready_is_seen():
    status = '{"nodes":[{"name":"hub","state":"ready"},{"name":"ros2","state":"starting"}]}'
    installed.require_ready(["hub"], status)
    with pytest.raises(installed.Failed, match="not ready: mavlink, ros2"):
        installed.require_ready(["ros2", "hub", "mavlink"], status)
