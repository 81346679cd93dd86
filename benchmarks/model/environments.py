"""Python environments of the peers below .cache, created when first needed."""

import os
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).parents[2]
_HOME = ROOT / ".cache" / "peers"

PACKAGES = {
    "rotorpy": ("rotorpy==3.0.0", "torch", "torchdiffeq", "roma"),
    "mujoco": ("mujoco==4.0.0", "numpy"),
    "crazyflow": ("crazyflow==0.4.0",),
}
"""Packages that pip installs, by peer."""


_ONE_CORE = ("taskset", "-c", str(min(os.sched_getaffinity(0))))


class Missing(Exception):
    """Absence of a peer that cannot be installed or run on this machine."""


def python(peer: str) -> Path:
    """Return the interpreter of a peer's environment with the peer installed; raise Missing."""
    folder = _HOME / peer
    interpreter = folder / "bin" / "python"
    ready = folder / ".ready"
    wanted = " ".join(PACKAGES[peer])
    if not (ready.exists() and ready.read_text(encoding="utf-8") == wanted):
        print(f"installing {wanted} into {folder.relative_to(ROOT)}", file=sys.stderr)
        venv.create(folder, clear=True, with_pip=True)
        command = [str(interpreter), "-m", "pip", "install", "--quiet", *PACKAGES[peer]]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise Missing(f"pip install {wanted}: {done.stderr.strip().splitlines()[-1]}")
        ready.write_text(wanted, encoding="utf-8")
    return interpreter


def run(peer: str, module: str, *arguments: str) -> str:
    """Return the output of a module of peers/ in a peer's environment; raise Missing if it fails."""
    command = [str(python(peer)), "-m", f"benchmarks.model.peers.{module}", *arguments]
    # One thread each, and one core: the figures are per core, and JAX's threads lose a third of the
    # processor's time to one another.
    one = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    environment = os.environ | one | {"JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [*_ONE_CORE, *command],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise Missing(f"{peer}: {done.stderr.strip().splitlines()[-1:]}")
    return done.stdout.strip().splitlines()[-1]
