"""Certificate authority of a fleet: P-256 keys, and certificates that are valid for days."""

import datetime as dt
import ipaddress
import secrets
import socket
import sys
from contextlib import suppress
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.files import making
from quadctl.services.runtime.realm import write_atomically
from quadctl.services.runtime.security.identity import (
    CERTIFICATE,
    FLEET,
    KEY,
    Name,
    check_key_identifier,
)

FLEET_KEY = "ca-key.pem"
_YEARS = 10
_SLACK = dt.timedelta(minutes=5)
"""Largest difference between the clocks of two machines."""
_NOWHERE = ("192.0.2.1", 9)
"""TEST-NET-1 (RFC 5737): connecting a UDP socket shows our address without sending a packet."""


class Authority:
    """Folder with a fleet's public certificate, `ca.pem`, and its secret key, `ca-key.pem`."""

    def __init__(self, folder: Path) -> None:
        """Load the fleet's keys; raises UsageError if the folder has none, or old ones."""
        try:
            self._certificate = x509.load_pem_x509_certificate((folder / FLEET).read_bytes())
            key = load_pem_private_key((folder / FLEET_KEY).read_bytes(), None)
        except (OSError, ValueError) as error:
            raise UsageError(
                f"{folder} has no fleet's keys",
                "`quadctl keys init` makes them; --fleet names them",
            ) from error
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            raise UsageError(f"{folder / FLEET_KEY} is not a fleet's key")
        check_key_identifier(str(folder / FLEET))
        self._key = key

    @staticmethod
    def found(folder: Path) -> None:
        """Make a new fleet's key and certificate; raises UsageError if the folder has a fleet."""
        if (folder / FLEET_KEY).exists():
            raise UsageError(f"{folder} has a fleet's keys already", "name another --fleet")
        key, now = ec.generate_private_key(ec.SECP256R1()), dt.datetime.now(dt.UTC)
        itself = _named(f"quadctl fleet {secrets.token_hex(4)}")
        builder = (
            x509.CertificateBuilder(itself, itself, key.public_key(), x509.random_serial_number())
            .not_valid_before(now - _SLACK)
            .not_valid_after(now + dt.timedelta(days=365 * _YEARS))
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(signs=True), critical=True)
        )
        certificate = _signed(builder, key, key)
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        _write(folder / FLEET, certificate)
        _write_key(folder / FLEET_KEY, key)

    def issue(self, name: Name, hosts: list[str], folder: Path) -> None:
        """Write a name's certificate and key, and the fleet's certificate, to a folder.

        Only a hub's certificate allows connections to it, at the given `hosts`.
        """
        key, usages = ec.generate_private_key(ec.SECP256R1()), [ExtendedKeyUsageOID.CLIENT_AUTH]
        builder = (
            x509.CertificateBuilder()
            .subject_name(_named(name.common_name))
            .issuer_name(self._certificate.subject)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(dt.datetime.now(dt.UTC) - _SLACK)
            .not_valid_after(dt.datetime.fromtimestamp(name.expires, dt.UTC))
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs=False), critical=True)
        )
        if name.role == "hub":
            usages.append(ExtendedKeyUsageOID.SERVER_AUTH)
            if hosts:  # an empty list of addresses is no valid one
                at = x509.SubjectAlternativeName([_host(host) for host in hosts])
                builder = builder.add_extension(at, critical=False)
        builder = builder.add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        certificate = _signed(builder, key, self._key)
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        _write_key(folder / KEY, key)
        _write(folder / CERTIFICATE, certificate)
        _write(folder / FLEET, self._certificate.public_bytes(Encoding.PEM))


def hosts_here() -> list[str]:
    """Return the names and addresses by which other machines probably reach this one."""
    found = ["localhost", "127.0.0.1", socket.gethostname()]
    # Without a network connect() fails, and the machine has no other address.
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
        probe.connect(_NOWHERE)
        found.append(probe.getsockname()[0])
    return list(dict.fromkeys(found))


def _host(host: str) -> x509.GeneralName:
    with suppress(ValueError):
        return x509.IPAddress(ipaddress.ip_address(host))
    try:
        return x509.DNSName(host)
    except ValueError as error:
        raise UsageError(f"--host {host}: neither a name nor an address") from error


def _named(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def _signed(
    builder: x509.CertificateBuilder,
    key: ec.EllipticCurvePrivateKey,
    authority: ec.EllipticCurvePrivateKey,
) -> bytes:
    """Return the certificate of a key in PEM, with the identifiers of both keys (RFC 5280)."""
    subject = x509.SubjectKeyIdentifier.from_public_key(key.public_key())
    issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.public_key())
    builder = builder.add_extension(subject, critical=False).add_extension(issuer, critical=False)
    return builder.sign(authority, hashes.SHA256()).public_bytes(Encoding.PEM)


def _usage(*, signs: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs,
        key_cert_sign=signs,
        crl_sign=signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _write_key(path: Path, key: ec.EllipticCurvePrivateKey) -> None:
    _write(path, key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))


def _write(path: Path, data: bytes) -> None:
    """Write the file, whole or not at all, so that at no time any other user can read it."""
    with making(path):
        write_atomically(path, data, 0o600)
    if sys.platform != "win32":
        path.chmod(0o600)
