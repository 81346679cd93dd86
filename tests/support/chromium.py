"""Whether there is a Chromium for the console's tests, and what is said where there is none."""

import os
import shutil

REQUIRED = "QUADCTL_TEST_BROWSER"
"""Set to `required` where its absence is a failure, as in continuous integration."""
_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

MISSING = (
    "The console's page: its tests drive a Chromium, and there is none on the path."
    " `apt install chromium` (Debian, Ubuntu) or any Chrome will do."
)


def found() -> str | None:
    """Where it is."""
    return next(filter(None, map(shutil.which, _NAMES)), None)


def wanted() -> bool:
    """Whether its tests are to run: they fail where one is required and there is none."""
    return found() is not None or os.environ.get(REQUIRED) == "required" or "CI" in os.environ
