"""Loads msgspec without typing_extensions, where some other package has brought that along.

What msgspec would take from it has been in typing since 3.11, and its import takes 13 ms of every
command.
"""

import gc
import sys

gc.disable()  # what is imported stays; to look through it again and again takes 10 ms

_NAME = "typing_extensions"
_wanted = _NAME in sys.modules
if not _wanted:
    sys.modules[_NAME] = None  # type: ignore[assignment] # an import of it fails, as if not there

import msgspec  # noqa: E402, F401 - loaded here so that all later imports find it loaded

if not _wanted:
    del sys.modules[_NAME]
