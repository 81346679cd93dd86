"""A fleet's keys: certificates, their expiry and revocation, and file permissions."""

import datetime as dt
import stat
import time
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from quadctl.schemas.roles import ROLES
from quadctl.services.runtime.errors import Invalid, NotAllowed, UsageError
from quadctl.services.runtime.security import registry
from quadctl.services.runtime.security.access_control import access_control, identity_for
from quadctl.services.runtime.security.identity import VARIABLE, Identity, current, needed
from quadctl.services.runtime.security.registry import NameList, Registry


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    Registry(tmp_path / "keys").init()
    return tmp_path / "keys"


def certificate(folder: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate((folder / "cert.pem").read_bytes())


def usages(made: x509.Certificate) -> list[x509.ObjectIdentifier]:
    return list(made.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)


def test_a_certificate_has_its_holders_name_and_expires(folder: Path):
    (anna,) = Registry(folder).issue("operator", {"anna": ["uav7"]}, 2.0, [])
    made = certificate(folder / "anna")
    (common_name,) = made.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    assert common_name.value == anna.common_name == f"operator.anna.{anna.serial}"
    assert isinstance(made.public_key(), ec.EllipticCurvePublicKey)
    left = made.not_valid_after_utc - dt.datetime.now(dt.UTC)
    assert dt.timedelta(days=1.9) < left <= dt.timedelta(days=2)
    fleet = x509.load_pem_x509_certificate((folder / "ca.pem").read_bytes())
    made.verify_directly_issued_by(fleet)
    assert (folder / "anna" / "ca.pem").read_bytes() == (folder / "ca.pem").read_bytes()


def test_only_a_hubs_certificate_is_valid_for_a_server(folder: Path):
    Registry(folder).issue("hub", {"field": ["*"]}, 1, ["10.7.1.1", "field.local"])
    Registry(folder).issue("student", {"bob": ["uav"]}, 1, [])
    hub, student = certificate(folder / "field"), certificate(folder / "bob")
    assert ExtendedKeyUsageOID.SERVER_AUTH in usages(hub)
    assert usages(student) == [ExtendedKeyUsageOID.CLIENT_AUTH]
    at = hub.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert at.get_values_for_type(x509.DNSName) == ["field.local"]
    assert [str(ip) for ip in at.get_values_for_type(x509.IPAddress)] == ["10.7.1.1"]
    assert not hub.extensions.get_extension_for_class(x509.BasicConstraints).value.ca


def test_keys_are_readable_only_by_their_owner(folder: Path):
    Registry(folder).issue("operator", {"anna": ["*"]}, 1, [])
    for key in (folder / "ca-key.pem", folder / "anna" / "key.pem"):
        assert stat.S_IMODE(key.stat().st_mode) == 0o600
    for place in (folder, folder / "anna"):
        assert stat.S_IMODE(place.stat().st_mode) == 0o700
    (folder / "anna" / "key.pem").chmod(0o640)
    with pytest.raises(UsageError, match=r"key\.pem can be read by others") as caught:
        Identity(str(folder / "anna"))
    assert "chmod 600" in caught.value.hint


def test_every_hubs_folder_has_the_list_of_names(folder: Path):
    fleet = Registry(folder)
    fleet.issue("operator", {"anna": ["*"]}, 1, [])
    fleet.issue("hub", {"field": ["*"], "uav7": ["uav7"]}, 1, [])
    names = NameList(str(folder / "field"))
    assert [name.name for name in names.known] == ["anna", "field", "uav7"]
    assert names.changed() is None
    for place in (folder, folder / "field", folder / "uav7"):
        assert [name.name for name in registry.load(place)] == ["anna", "field", "uav7"]
    assert fleet.revoke("anna").name == "anna"
    assert [name.name for name in names.changed() or []] == ["field", "uav7"]
    assert [name.name for name in registry.load(folder / "field")] == ["field", "uav7"]
    assert not (folder / "anna").exists()


def test_a_list_that_cannot_be_read_changes_nothing_and_is_logged_once(
    folder: Path, caplog: pytest.LogCaptureFixture
):
    fleet, file = Registry(folder), folder / "names.json"
    fleet.issue("operator", {"anna": ["*"], "tim": ["*"]}, 1, [])
    with pytest.raises(UsageError, match="is not there"):
        NameList(str(folder / "nowhere"))
    names = NameList(str(folder))
    fleet.revoke("tim")
    assert [name.name for name in names.changed() or []] == ["anna"]
    whole = file.read_bytes()
    for partial in (b"", whole[:9], whole[:-3]):
        file.write_bytes(partial)
        assert names.changed() is None
    file.unlink()
    assert names.changed() is None
    assert [name.name for name in names.known] == ["anna"]
    (message,) = caplog.messages
    assert "is not a list of names" in message
    file.write_bytes(whole.replace(b"anna", b"hans"))
    assert [name.name for name in names.changed() or []] == ["hans"]


def test_a_new_certificate_revokes_the_old_one(folder: Path):
    fleet = Registry(folder)
    (old,) = fleet.issue("operator", {"anna": ["*"]}, 1, [])
    (new,) = fleet.issue("student", {"anna": ["uav7"]}, 1, [])
    assert fleet.names() == [new]
    assert old.serial != new.serial
    assert Identity(str(folder / "anna")).name == new


def test_invalid_requests_are_rejected(folder: Path, tmp_path: Path):
    fleet = Registry(folder)
    fleet.issue("operator", {"anna": ["*"]}, 1, [])
    with pytest.raises(Invalid, match="there is no certificate ana") as caught:
        fleet.revoke("ana")
    assert "anna" in caught.value.hint
    with pytest.raises(UsageError, match="has a fleet's keys already"):
        fleet.init()
    with pytest.raises(UsageError, match=r"names\.json is not there"):
        Registry(tmp_path / "nowhere").names()
    with pytest.raises(UsageError, match="has no fleet's keys"):
        Registry(tmp_path / "nowhere").issue("hub", {"x": ["*"]}, 1, [])
    with pytest.raises(UsageError, match="neither a name nor an address"):
        fleet.issue("hub", {"x": ["*"]}, 1, ["käse"])
    (folder / "names.json").write_text("[{]", encoding="utf-8")
    with pytest.raises(Invalid, match="is not a list of names"):
        fleet.names()


def test_the_identity_comes_from_the_environment(folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    assert current() is None
    with pytest.raises(UsageError, match="tls/x:1 needs an identity"):
        needed("tls/x:1")
    fleet = Registry(folder)
    fleet.issue("operator", {"anna": ["*"]}, 1, [])
    fleet.issue("hub", {"field": ["*"]}, 1, [])
    monkeypatch.setenv(VARIABLE, str(folder / "anna"))
    assert needed("tls/x:1").name.role == "operator"
    with pytest.raises(UsageError, match="needs the identity of a hub"):
        identity_for(["tls/x:1"])
    monkeypatch.setenv(VARIABLE, str(folder / "field"))
    assert identity_for(["tls/x:1"]).name.role == "hub"
    made = access_control(fleet.names(), time.time(), "unixsock-stream")
    assert {subject["id"] for subject in made["subjects"]} == {"own", *(f"{r} of *" for r in ROLES)}


def test_a_missing_expired_or_damaged_identity_is_rejected(folder: Path, tmp_path: Path):
    with pytest.raises(UsageError, match=r"has no readable ca\.pem"):
        Identity(str(tmp_path))
    Registry(folder).issue("operator", {"anna": ["*"]}, 1e-9, [])
    time.sleep(0.001)
    with pytest.raises(NotAllowed, match="expired on") as caught:
        Identity(str(folder / "anna"))
    assert "quadctl keys issue operator anna" in caught.value.hint
    (folder / "anna" / "identity.json").write_text("{}", encoding="utf-8")
    with pytest.raises(UsageError, match="is damaged"):
        Identity(str(folder / "anna"))
