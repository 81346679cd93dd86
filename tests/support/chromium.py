"""Search for the Chromium of the console's tests, and the message when it is missing."""

import os
import shutil

REQUIRED = "QUADCTL_TEST_BROWSER"
"""Environment variable; `required` makes a missing Chromium a failure, e.g. in CI."""
_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

MISSING = (
    "The console's page: its tests drive a Chromium, and there is none on the path."
    " `apt install chromium` (Debian, Ubuntu) or any Chrome will do."
)


def found() -> str | None:
    """Return the path of Chromium, or None."""
    return next(filter(None, map(shutil.which, _NAMES)), None)


def wanted() -> bool:
    """Return whether its tests run: they also run, and fail, if a required one is missing."""
    return found() is not None or os.environ.get(REQUIRED) == "required" or "CI" in os.environ
