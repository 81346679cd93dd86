"""Environment of a checkout, for make: what a user needs, and on top of it what a developer does.

    python3 deploy/environment.py .venv user        # sets it up; or: developer
    python3 deploy/environment.py                   # exits with 0 if this Python fits

It is set up whole or not at all: the stamps that make compares with the locks go first and come last, and
the former environment is put back if a new one fails. Nothing changes outside the checkout. This file is
written for Python 3.6 too, to tell its owner what is missing.
"""

import errno
import fcntl
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

NEEDED = (3, 11)
USER, DEVELOPER = "user", "developer"
STAMPS = {USER: ".demo-ready", DEVELOPER: ".ready"}
SPACE = {USER: 500, DEVELOPER: 2000}
"""Free space (MB) that a set-up takes at its peak, with pip's copies."""
FULL = 20_000_000
"""Free space (bytes) below which a step has failed for want of space."""
CACHE = Path(".cache")
SCRATCH = CACHE / "set-up"
"""Temporary files of pip, which a killed pip leaves behind."""
LOG = CACHE / "set-up.log"
AGAIN = "then run make again"


class Impossible(Exception):
    """Fault of the machine, with the reason and the remedy."""


def main(*words: str) -> int:
    """Set up the environment and stage of a command line; return the exit code."""
    # SIGTERM ends a set-up as Ctrl-C does: the former environment is put back.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        _check_python()
        if words:
            environment, stage = words
            _set_up(Path(environment), stage)
    except Impossible as problem:
        print(problem, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("The set-up was interrupted; make begins it anew.", file=sys.stderr)
        return 130
    return 0


def _check_python() -> None:
    """Raise Impossible unless this Python is new enough and can make environments."""
    needed, version = ("{}.{}".format(*numbers) for numbers in (NEEDED, sys.version_info))
    if sys.version_info < NEEDED:
        raise Impossible(
            f"quadctl needs Python {needed} or newer, and {sys.executable} is {version}:"
            f" install one, or name one: make PYTHON=/path/to/python{needed}."
        )
    missing = [name for name in ("venv", "ensurepip") if importlib.util.find_spec(name) is None]
    if missing:
        raise Impossible(
            f"{sys.executable} makes no environments, as it has no {' and no '.join(missing)}:"
            f" install it (Debian, Ubuntu: apt install python3-venv), {AGAIN}."
        )


def _set_up(environment: Path, stage: str) -> None:
    """Set up an environment; raise Impossible, with the environment as it was, if that fails."""
    here = Path.cwd()
    try:
        _check_space(stage)
        with _alone() as lock:
            print(f"Setting up {environment}, once: a minute or so.", flush=True)
            if stage == USER:
                _renew(environment, lock)
            else:
                _extend(environment, lock)
    except OSError as problem:
        full = problem.errno in (errno.ENOSPC, errno.EDQUOT)
        remedy = (
            f"make room for {SPACE[stage]} MB there"
            if full
            else "use a checkout that you may write to"
        )
        raise Impossible(
            f"{environment} cannot be set up in {here} ({problem.strerror}): {remedy}, {AGAIN}."
        ) from problem


def _check_space(stage: str) -> None:
    """Raise OSError if the disk has too little space for a stage."""
    free = shutil.disk_usage(".").free // 1_000_000
    if free < SPACE[stage]:
        raise OSError(errno.ENOSPC, f"{free} MB are free")


@contextmanager
def _alone() -> "Iterator[IO[str]]":
    """Keep other set-ups out of the checkout, also while a pip lives that outlived its make."""
    CACHE.mkdir(exist_ok=True)
    with (CACHE / "set-up.lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise Impossible(
                f"Another make sets up an environment in this checkout: wait for its end, {AGAIN}."
            ) from None
        _remove(SCRATCH)
        SCRATCH.mkdir()
        try:
            yield lock
        finally:
            _remove(SCRATCH)


def _renew(environment: Path, lock: IO[str]) -> None:
    """Make an environment for users; put the former one back if that fails."""
    former = environment.with_name(f"{environment.name}-former")
    if environment.exists() and not former.exists():  # otherwise what is there was not finished
        environment.rename(former)
    _remove(environment)
    try:
        _run(lock, sys.executable, "-m", "venv", environment)
        _install(lock, environment, "requirements.lock", "requirements-build.lock")
        _remove(former)
    except BaseException:
        _remove(environment)
        if former.exists():
            former.rename(environment)
        raise
    (environment / STAMPS[USER]).touch()


def _extend(environment: Path, lock: IO[str]) -> None:
    """Add what developers need to an environment for users."""
    if (environment / STAMPS[DEVELOPER]).exists():
        # Packages that are not needed any more would stay.
        _renew(environment, lock)
    [packages] = environment.glob("lib/python*/site-packages")
    before = packages.stat().st_mtime_ns
    stamp = environment / STAMPS[USER]
    stamp.unlink()
    try:
        _install(lock, environment, "requirements-dev.lock")
    except BaseException:
        if packages.stat().st_mtime_ns == before:  # pip has failed before it changed anything
            stamp.touch()
        raise
    stamp.touch()
    (environment / STAMPS[DEVELOPER]).touch()


def _install(lock: IO[str], environment: Path, *files: str) -> None:
    """Install the packages of lock files, and the checkout itself."""
    python = environment / "bin/python"
    # Python compiles a module when it is first imported: most never are, and pip uses one processor.
    pip = (python, "-m", "pip", "install", "--no-compile", "--retries", "3", "--no-input")
    _run(lock, *pip, "--require-hashes", *(f"--requirement={file}" for file in files))
    _run(lock, *pip, "--no-deps", "--no-build-isolation", "--editable", ".")


def _run(lock: IO[str], *command: object) -> None:
    """Run a step of the set-up; raise Impossible with its own reason if it fails."""
    done = subprocess.run(
        [str(word) for word in command],
        check=False,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        env={**os.environ, "TMPDIR": str(SCRATCH.resolve())},
        pass_fds=[lock.fileno()],
    )
    if done.returncode:
        LOG.write_text(done.stdout, encoding="utf-8")
        raise Impossible(f"{_reason(done.stdout)}, {AGAIN}. {LOG} has the whole output.")


def _reason(said: str) -> str:
    """Return the fault and the remedy that the output of a failed step tells."""
    full = os.strerror(errno.ENOSPC)
    # pip clears up before it ends, and venv keeps the words of its steps to itself.
    if full in said or shutil.disk_usage(".").free < FULL:
        raise OSError(errno.ENOSPC, full)
    if "(from versions: none)" in said:
        return "No package index answers: connect this machine to one, or name one in pip's configuration"
    lines = said.strip().splitlines() or ["the step was killed"]
    faults = [line for line in lines if line.lower().startswith("error:")]
    return f"The set-up failed ({(faults or lines)[-1]}): mend that"


def _remove(folder: Path) -> None:
    """Remove a folder, its stamps first: the half of it that an interruption leaves is not ready."""
    for stamp in STAMPS.values():
        if (folder / stamp).exists():
            (folder / stamp).unlink()
    if folder.exists():
        shutil.rmtree(str(folder))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
