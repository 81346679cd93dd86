"""Modules that are written by a program, kept in the user's cache folder."""

import hashlib
import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType

from services.runtime.realm import write_atomically


def load(name: str, source: str) -> ModuleType:
    """Import a module with this text, and its digest in its name: another text is another module.

    It is a file, and stays: what a compiler makes of it is kept beside it for the next time.
    """
    digest = hashlib.sha256(source.encode()).hexdigest()[:12]
    path = folder() / f"{name}_{digest}.py"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, source.encode())
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} cannot be imported")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # where a compiler looks it up again
    spec.loader.exec_module(module)
    return module


def folder() -> Path:
    """Where they are kept."""
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "quadctl"
