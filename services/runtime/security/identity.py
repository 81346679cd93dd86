"""Identity of a process: a folder with certificate and key."""

import binascii
import os
import sys
import time
from typing import Any

import msgspec
from msgspec import Struct

from quadctl.schemas.roles import Role
from quadctl.schemas.typed import from_json
from quadctl.services.runtime.errors import NotAllowed, UsageError


class Name(Struct, frozen=True):
    """Holder of a certificate, which is valid until `expires` (Unix time, s)."""

    name: str
    role: Role
    vehicles: list[str]
    serial: str
    expires: float

    @property
    def common_name(self) -> str:
        """Return the certificate's common name, e.g. `student.anna.1a2b3c4d`."""
        return f"{self.role}.{self.name}.{self.serial}"

    @property
    def of(self) -> str:
        """Return its vehicles as text for a message."""
        return "all vehicles" if self.vehicles == ["*"] else ", ".join(self.vehicles)


VARIABLE = "QUADCTL_IDENTITY"
"""Environment variable with the folder, inherited by child processes; `--identity` sets it."""
FLEET, CERTIFICATE, KEY, ABOUT = "ca.pem", "cert.pem", "key.pem", "identity.json"
_HINT = "issue one with `quadctl keys issue operator anna`, and copy its folder"
_KEY_IDENTIFIERS = {FLEET: b"\x06\x03\x55\x1d\x0e", CERTIFICATE: b"\x06\x03\x55\x1d\x23"}
"""Extension that strict verifiers ask for, as in DER: the Subject's in a fleet's certificate, the
Authority's in a member's (RFC 5280, 4.2.1). To import a parser takes longer than a call on the bus.
"""


class Identity:
    """Folder made by `quadctl keys issue`."""

    def __init__(self, folder: str) -> None:
        """Raise NotAllowed if the certificate has expired, UsageError for a file of no use."""
        self.folder = folder
        for file in (FLEET, CERTIFICATE, KEY, ABOUT):
            if not os.access(self.path(file), os.R_OK):
                raise UsageError(f"the identity {folder} has no readable {file}", _HINT)
        key = self.path(KEY)
        if sys.platform != "win32" and os.stat(key).st_mode & 0o077:
            raise UsageError(f"{key} can be read by others on this machine", f"chmod 600 {key}")
        try:
            with open(self.path(ABOUT), "rb") as about:
                self.name = from_json(about.read(), Name)
        except msgspec.DecodeError as error:
            raise UsageError(f"{self.path(ABOUT)} is damaged: {error}", _HINT) from error
        if self.name.expires <= time.time():
            day = time.strftime("%Y-%m-%d %H:%M", time.localtime(self.name.expires))
            raise NotAllowed(
                f"the certificate {self.name.common_name} expired on {day}",
                f"issue it again with `quadctl keys issue {self.name.role} {self.name.name}`",
            )

        for file in _KEY_IDENTIFIERS:
            check_key_identifier(self.path(file))

    def path(self, file: str) -> str:
        """Return the full path of one of its files."""
        return os.path.join(os.path.abspath(self.folder), file)

    def tls(self) -> dict[str, Any]:
        """Return Zenoh's `transport.link.tls`: both sides show and verify a certificate."""
        key, certificate = self.path(KEY), self.path(CERTIFICATE)
        return {
            "root_ca_certificate": self.path(FLEET),
            "listen_private_key": key,
            "listen_certificate": certificate,
            "connect_private_key": key,
            "connect_certificate": certificate,
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }


def check_key_identifier(path: str) -> None:
    """Raise UsageError if the certificate, `ca.pem` or `cert.pem`, has no key identifier.

    Python 3.13 and later, among others, refuse it then. All do here: machines of a fleet differ.
    """
    with open(path, "rb") as file:
        pem = file.read()
    try:
        der = binascii.a2b_base64(pem.split(b"-----")[2])
    except (IndexError, binascii.Error) as error:
        raise UsageError(f"{path} is no certificate", _HINT) from error
    if _KEY_IDENTIFIERS[os.path.basename(path)] not in der:
        raise UsageError(
            f"{path} was made by an older quadctl: it has no key identifier, and Python 3.13 and"
            " later refuse it",
            "move the folder of the fleet's keys away, make new ones with `quadctl keys init`, and"
            " issue all certificates again with `quadctl keys issue`",
        )


def choose(folder: str) -> None:
    """Use this identity from now on, in this process and its children."""
    os.environ[VARIABLE] = os.path.abspath(folder)


def current() -> Identity | None:
    """Return our identity, None if the environment has none; raises as Identity."""
    folder = os.environ.get(VARIABLE)
    return Identity(folder) if folder else None


def needed(endpoint: str) -> Identity:
    """Return our identity for an endpoint that needs one; raises UsageError if there is none."""
    found = current()
    if found is None:
        raise UsageError(
            f"{endpoint} needs an identity",
            f"give --identity DIR, or set {VARIABLE}; `quadctl keys issue` makes DIR",
        )
    return found
