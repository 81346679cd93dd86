"""Wheel in fresh environments, each tried as its user would: for `make release`, on any machine.

    python3 deploy/installed.py WHEEL UV

pip and `uv tool` install it without extras, with each alone and with all, from the index that they are set up
for. In each environment a run flies with the bridges of its extras, the console answers, and `doctor` finds
no fault. It needs nothing but Python: bare machines run it, too. UV is a requirement, e.g. uv==0.13.8.
"""

import json
import os
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from email.parser import Parser
from pathlib import Path

BRIDGES = ("foxglove", "mavlink", "ros2")
USES = {
    "cluster": ("campaign", "--flights", "4", "--seconds", "10", "--dask", "local"),
    "fleet": ("campaign", "--search", "5"),
}
"""Command that needs an extra; the extra `console` has a trial of its own, those of bridges have `up`."""
ALL = "all extras"
NONE: Mapping[str, str] = {}
SECONDS = 1200
"""Most seconds that a step may take, an installation on a slow line among them."""

Install = Callable[[Path, str], Path]
"""Function that installs a requirement into an empty folder, and returns the command quadctl there."""


class Failed(Exception):
    """Step that failed, with the end of its output."""


def main(wheel: Path, uv: str) -> int:
    """Try the wheel in every environment; return the exit code."""
    name, version, extras = metadata(wheel)
    if untried := set(extras) - {*BRIDGES, *USES, "console"}:
        print(f"deploy/installed.py has no trial of the extra {', '.join(sorted(untried))}")
        return 1
    where = "uv"
    try:
        with tempfile.TemporaryDirectory(prefix="quad") as scratch:
            for installer, install in installers(Path(scratch), uv).items():
                for chosen in selections(extras):
                    where = f"{installer}, {described(chosen)}"
                    began = time.monotonic()
                    with tempfile.TemporaryDirectory(prefix="quad") as folder:
                        quadctl = install(Path(folder), requirement(name, chosen, wheel))
                        expect(f"{name} {version}", quadctl, "--version")
                        use(quadctl, Path(folder), chosen, demo=len(chosen) != 1)
                    print(f"{where}: {time.monotonic() - began:.0f} s", flush=True)
    except Failed as problem:
        print(f"{where}: {problem}")
        return 1
    return 0


def metadata(wheel: Path) -> tuple[str, str, list[str]]:
    """Return the name, the version and the extras that a wheel declares."""
    with zipfile.ZipFile(wheel) as archive:
        [file] = [path for path in archive.namelist() if path.endswith(".dist-info/METADATA")]
        found = Parser().parsestr(archive.read(file).decode("utf-8"))
    return found["Name"], found["Version"], found.get_all("Provides-Extra", [])


def selections(extras: list[str]) -> Iterator[list[str]]:
    """Yield no extra, each alone, and all together."""
    yield []
    yield from ([extra] for extra in extras)
    yield extras


def requirement(name: str, extras: list[str], wheel: Path) -> str:
    """Return the requirement of a wheel with extras, as pip and uv read it."""
    chosen = f"[{','.join(extras)}]" if extras else ""
    return f"{name}{chosen} @ {wheel.resolve().as_uri()}"


def described(extras: list[str]) -> str:
    """Return words for a selection of extras."""
    return {0: "no extra", 1: f"[{''.join(extras)}]"}.get(len(extras), ALL)


def installers(scratch: Path, uv: str) -> dict[str, Install]:
    """Return the ways to install, with a uv of their own in a scratch folder."""
    tools = scratch / "tools"
    run(sys.executable, "-m", "venv", tools)
    run(tools / "bin/python", "-m", "pip", "install", "--quiet", uv)

    def by_pip(folder: Path, wanted: str) -> Path:
        run(sys.executable, "-m", "venv", folder / "venv")
        run(folder / "venv/bin/python", "-m", "pip", "install", "--quiet", wanted)
        return folder / "venv/bin/quadctl"

    def by_uv(folder: Path, wanted: str) -> Path:
        places = {
            "UV_TOOL_DIR": str(folder / "tools"),
            "UV_TOOL_BIN_DIR": str(folder / "bin"),
            "UV_CACHE_DIR": str(scratch / "cache"),
        }
        words = ("tool", "install", "--quiet", "--python", sys.executable, wanted)
        run(tools / "bin/uv", *words, variables=places)
        return folder / "bin/quadctl"

    return {"pip": by_pip, "uv tool": by_uv}


def use(quadctl: Path, folder: Path, extras: list[str], *, demo: bool) -> None:
    """Use an installed quadctl as its extras allow, in a realm of its own; raise Failed."""
    place = {"XDG_RUNTIME_DIR": str(folder), "XDG_CACHE_HOME": str(folder / "cache")}

    def ask(*words: str) -> str:
        return run(quadctl, *words, cwd=folder, variables=place)

    if demo:
        ask("demo")
    bridges = [extra for extra in extras if extra in BRIDGES]
    if "foxglove" in bridges:  # another program may have the usual port
        command = f"{quadctl} bridge foxglove --port {free_port()}"
        (folder / "quad.toml").write_text(f'[processes]\nfoxglove = "{command}"\n', "utf-8")
    try:
        ask("up", "-d", *(f"--bridge={each}" for each in bridges if each != "foxglove"))
        expect("arrived", quadctl, "goto", "1", "2", "1", cwd=folder, variables=place)
        require_ready(bridges, ask("status", "--json"))
        if "console" in extras:
            watch_console(quadctl, folder, place)
        if (
            len(extras) == 1 and extras[0] in USES
        ):  # with all extras it would take the same minute again
            ask(*USES[extras[0]])
        ask("doctor")
    except BaseException:
        with suppress(Failed):
            ask("down")
        raise
    ask("down")


def free_port() -> int:
    """Return a port of this machine that no program has."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
        return port


def require_ready(nodes: list[str], status: str) -> None:
    """Raise Failed if a node is not ready by the output of `status --json`."""
    ready = {node["name"] for node in json.loads(status)["nodes"] if node["state"] == "ready"}
    if away := set(nodes) - ready:
        raise Failed(f"not ready: {', '.join(sorted(away))}")


def watch_console(quadctl: Path, folder: Path, place: dict[str, str]) -> None:
    """Open the page of a console that runs for so long; raise Failed if it does not answer."""
    words = (quadctl, "console", "--json", "--port", "0")
    with subprocess.Popen(
        words, cwd=folder, env=environment(place), text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as console:  # fmt: skip
        try:
            if console.stdout is None or not (line := console.stdout.readline()):
                raise Failed(f"the console ended at its start\n{console.communicate()[1]}")
            with urllib.request.urlopen(json.loads(line)["url"], timeout=SECONDS) as page:  # noqa: S310 - ours
                if page.status != 200 or b"quadctl" not in page.read():
                    raise Failed("the console's page is not ours")
        except OSError as problem:
            raise Failed(f"the console does not answer: {problem}") from problem
        finally:
            console.terminate()


def expect(
    text: str, *command: object, cwd: Path | None = None, variables: Mapping[str, str] = NONE
) -> None:
    """Run a command; raise Failed if its output lacks a text."""
    said = run(*command, cwd=cwd, variables=variables)
    if text not in said:
        raise Failed(f"{text!r} is not in the output of {spelled(command)}: {said.strip()}")


def run(*command: object, cwd: Path | None = None, variables: Mapping[str, str] = NONE) -> str:
    """Return the standard output of a command; raise Failed with its reason if it fails."""
    try:
        done = subprocess.run(
            [str(word) for word in command], check=False, cwd=cwd, env=environment(variables),
            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=SECONDS,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise Failed(f"{spelled(command)} takes longer than {SECONDS} s") from None
    if done.returncode:
        said = (done.stdout + done.stderr).strip()[-2000:]
        raise Failed(f"{spelled(command)} exits with {done.returncode}\n{said}")
    return done.stdout


def environment(variables: Mapping[str, str]) -> dict[str, str]:
    """Return this environment with variables, and without those that would change what is tried."""
    own = ("PYTHON", "QUADCTL_", "VIRTUAL_ENV")
    return {k: v for k, v in os.environ.items() if not k.startswith(own)} | {**variables}


def spelled(command: tuple[object, ...]) -> str:
    """Return a command as it is typed, with the name of its program alone."""
    return " ".join([Path(str(command[0])).name, *map(str, command[1:])])


if __name__ == "__main__":
    try:
        sys.exit(main(Path(sys.argv[1]), sys.argv[2]))
    except KeyboardInterrupt:
        sys.exit("interrupted: nothing stays installed")
