"""Certificates as quadctl issued them before they had key identifiers."""

from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key

_SINCE = (x509.SubjectKeyIdentifier, x509.AuthorityKeyIdentifier)


def age(fleet: Path, *certificates: Path) -> None:
    """Sign certificates of a fleet again, without key identifiers."""
    key = load_pem_private_key((fleet / "ca-key.pem").read_bytes(), None)
    assert isinstance(key, ec.EllipticCurvePrivateKey)
    for path in certificates:
        new = x509.load_pem_x509_certificate(path.read_bytes())
        builder = x509.CertificateBuilder(
            new.issuer,
            new.subject,
            new.public_key(),
            new.serial_number,
            new.not_valid_before_utc,
            new.not_valid_after_utc,
            [each for each in new.extensions if not isinstance(each.value, _SINCE)],
        )
        path.write_bytes(builder.sign(key, hashes.SHA256()).public_bytes(Encoding.PEM))
