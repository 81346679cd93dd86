"""A file that is made anew: nothing that is there is written over."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from services.runtime.errors import Invalid


@contextmanager
def making(path: Path) -> Iterator[None]:
    """Tell why a file could not be made; raises Invalid."""
    try:
        yield
    except FileExistsError as error:
        raise taken(path) from error
    except OSError as error:
        raise Invalid(
            f"{path} cannot be written: {error.strerror}", "name a place that you may write to"
        ) from error


def taken(path: Path) -> Invalid:
    """What is told of a name that is in use."""
    return Invalid(f"{path} is there already", "name another file, or remove it")
