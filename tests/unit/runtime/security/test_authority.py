"""Issued certificates pass the strictest verifiers; those of older versions are refused."""

import ipaddress
import resource
import shutil
import ssl
import time
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509 import verification

from quadctl.schemas.roles import ROLES
from quadctl.services.runtime.errors import Invalid, UsageError
from quadctl.services.runtime.security.authority import Authority
from quadctl.services.runtime.security.identity import Identity, Name
from quadctl.services.runtime.security.registry import Registry
from tests.support.old_certificates import age

HOSTS = ["10.7.1.1", "fd00::7", "field.local"]


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keys of a fleet with a member of each role, named after it."""
    folder = tmp_path_factory.mktemp("fleet") / "keys"
    Registry(folder).init()
    for role in ROLES:
        Registry(folder).issue(role, {role: ["*"]}, 1.0, HOSTS)
    return folder


def context(identity: Path, purpose: ssl.Purpose) -> ssl.SSLContext:
    """Return the settings of a side that verifies the other as Python 3.13 does."""
    made = ssl.create_default_context(purpose, cafile=identity / "ca.pem")
    made.load_cert_chain(identity / "cert.pem", identity / "key.pem")
    made.verify_mode = ssl.CERT_REQUIRED
    made.verify_flags |= ssl.VERIFY_X509_STRICT
    return made


def shake(hub: Path, client: Path, host: str) -> None:
    """Make a TLS handshake between two identities; raises SSLError."""
    up, down = ssl.MemoryBIO(), ssl.MemoryBIO()
    serving = context(hub, ssl.Purpose.CLIENT_AUTH).wrap_bio(up, down, server_side=True)
    calling = context(client, ssl.Purpose.SERVER_AUTH).wrap_bio(down, up, server_hostname=host)
    waiting = [calling, serving]
    for _ in range(10):
        for side in list(waiting):
            try:
                side.do_handshake()
            except ssl.SSLWantReadError:
                continue
            waiting.remove(side)
    assert not waiting


def loaded(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


@pytest.mark.parametrize("role", ROLES)
def test_a_strict_handshake_accepts_every_role(fleet: Path, role: str):
    for host in HOSTS:
        shake(fleet / "hub", fleet / role, host)


def test_an_independent_verifier_accepts_a_hub(fleet: Path):
    """Check it by the rules for servers on the web, which browsers enforce."""
    rules = verification.PolicyBuilder().store(verification.Store([loaded(fleet / "ca.pem")]))
    *addresses, name = HOSTS
    known: list[x509.DNSName | x509.IPAddress] = [
        x509.DNSName(name),
        *(x509.IPAddress(ipaddress.ip_address(at)) for at in addresses),
    ]
    for host in known:
        rules.build_server_verifier(host).verify(loaded(fleet / "hub" / "cert.pem"), [])


def test_a_hub_without_addresses_can_still_join_others(fleet: Path, tmp_path: Path):
    Authority(fleet).issue(Name("joins", "hub", ["uav7"], "1a2b", time.time() + 60), [], tmp_path)
    shake(fleet / "hub", tmp_path, HOSTS[0])


@pytest.mark.parametrize("file", ["ca.pem", "cert.pem"])
def test_an_identity_of_an_older_version_is_refused(fleet: Path, tmp_path: Path, file: str):
    old = shutil.copytree(fleet / "operator", tmp_path / "operator")
    age(fleet, old / file)
    with pytest.raises(UsageError, match=rf"{file} was made by an older quadctl") as caught:
        Identity(str(old))
    assert "`quadctl keys init`" in caught.value.hint
    assert "`quadctl keys issue`" in caught.value.hint


def test_a_fleet_of_an_older_version_issues_nothing(fleet: Path, tmp_path: Path):
    old = shutil.copytree(fleet, tmp_path / "keys")
    age(old, old / "ca.pem")
    with pytest.raises(UsageError, match=r"ca\.pem was made by an older quadctl") as caught:
        Registry(old).issue("operator", {"anna": ["*"]}, 1.0, [])
    assert "`quadctl keys init`" in caught.value.hint
    assert not (old / "anna").exists()


@pytest.mark.parametrize(
    "text", ["", "-----BEGIN CERTIFICATE-----\nabc\n-----END CERTIFICATE-----"]
)
def test_a_damaged_certificate_is_refused(fleet: Path, tmp_path: Path, text: str):
    damaged = shutil.copytree(fleet / "operator", tmp_path / "operator")
    (damaged / "cert.pem").write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=r"cert\.pem is no certificate"):
        Identity(str(damaged))


def test_on_a_full_disk_no_part_of_a_certificate_is_left(tmp_path: Path):
    folder, before = tmp_path / "keys", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))  # acts as a full disk
    try:
        with pytest.raises(Invalid, match="cannot be written: File too large"):
            Registry(folder).init()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(folder.iterdir()) == []
    Registry(folder).init()
