"""A keystore as the SROS2 tools lay it out, made with the cryptography library.

    keystore/public/    identity_ca.cert.pem  permissions_ca.cert.pem
    keystore/private/   identity_ca.key.pem   permissions_ca.key.pem
    keystore/enclaves/  governance.xml  governance.p7s
    keystore/enclaves/learner_1/  cert.pem  key.pem  permissions.xml  permissions.p7s
                                  and links to governance.p7s and both certificates of authorities

Identities and permissions have authorities of their own. With one for both, as SROS2 makes it, a middleware that
accepts any signer below its authority lets each process sign permissions for itself with its own key.
"""

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import pkcs7
from cryptography.x509.oid import NameOID

from mabirds_bringup.security.permissions import Validity, governance_xml, permissions_xml
from mabirds_bringup.security.policy import Access
from mabirds_msgs_py.security import SecurityError

ENCLAVES, PUBLIC, PRIVATE = "enclaves", "public", "private"
GOVERNANCE = "governance.p7s"
MAX_NAME = 64
"""Characters of a certificate's common name, by X.520."""


@dataclass(frozen=True)
class Identity:
    """A certificate and the private key that goes with it."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def create_keystore(
    directory: Path, processes: Sequence[Access], domain: int, validity: Validity, *, overwrite: bool = False
) -> None:
    """Make a keystore with an enclave for each process; it appears whole or not at all.

    Raises SecurityError where there is something already; with ``overwrite``, only where that is no keystore.
    """
    directory = directory.absolute()
    _check_place(directory, overwrite=overwrite)
    directory.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{directory.name}-", dir=directory.parent) as scratch:
        made, before = Path(scratch, "made"), Path(scratch, "before")
        _fill(made, processes, domain, validity)
        if directory.exists():
            directory.rename(before)
        made.rename(directory)


def _check_place(directory: Path, *, overwrite: bool) -> None:
    if not directory.exists() or (directory.is_dir() and not any(directory.iterdir())):
        return
    if not (directory / ENCLAVES / GOVERNANCE).is_file():
        raise SecurityError(f"{directory}: is there already and is no keystore; choose another place")
    if not overwrite:
        raise SecurityError(
            f"{directory}: is a keystore already; choose another place, or give --overwrite to replace all its keys"
        )


def _fill(root: Path, processes: Sequence[Access], domain: int, validity: Validity) -> None:
    for name in (PUBLIC, PRIVATE, ENCLAVES):
        (root / name).mkdir(parents=True)
    (root / PRIVATE).chmod(0o700)
    identity_authority = _authority("identity", validity)
    permissions_authority = _authority("permissions", validity)
    for name, authority in (("identity_ca", identity_authority), ("permissions_ca", permissions_authority)):
        _write_certificate(root / PUBLIC / f"{name}.cert.pem", authority)
        _write_key(root / PRIVATE / f"{name}.key.pem", authority)
    _write_signed(root / ENCLAVES / "governance.xml", governance_xml(domain), permissions_authority)
    for process in processes:
        folder = root / ENCLAVES / process.enclave.lstrip("/")
        folder.mkdir(parents=True)
        identity = _identity(process.enclave, identity_authority, validity)
        _write_certificate(folder / "cert.pem", identity)
        _write_key(folder / "key.pem", identity)
        _write_signed(folder / "permissions.xml", permissions_xml(process, domain, validity), permissions_authority)
        _link(folder, root / PUBLIC / "identity_ca.cert.pem")
        _link(folder, root / PUBLIC / "permissions_ca.cert.pem")
        _link(folder, root / ENCLAVES / GOVERNANCE)


def _authority(kind: str, validity: Validity) -> Identity:
    """A self-signed authority, of which no other can be made."""
    name, key = _name(f"mabirds {kind} CA"), _new_key()
    builder = _builder(name, name, key, validity)
    usage = _usage(digital_signature=True, key_cert_sign=True, crl_sign=True)
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    builder = builder.add_extension(usage, critical=True)
    return Identity(builder.sign(key, hashes.SHA256()), key)


def _identity(enclave: str, authority: Identity, validity: Validity) -> Identity:
    """Who a process is: a certificate with the enclave's path for its name."""
    key = _new_key()
    builder = _builder(_name(enclave), authority.certificate.subject, key, validity)
    issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.key.public_key())
    builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
    builder = builder.add_extension(_usage(digital_signature=True), critical=True)
    builder = builder.add_extension(issuer, critical=False)
    return Identity(builder.sign(authority.key, hashes.SHA256()), key)


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, validity: Validity
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(validity.begin)
        .not_valid_after(validity.end)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _new_key() -> ec.EllipticCurvePrivateKey:
    """On prime256v1, the elliptic curve of DDS Security's DDS:Auth:PKI-DH."""
    return ec.generate_private_key(ec.SECP256R1())


def _name(common_name: str) -> x509.Name:
    if len(common_name) > MAX_NAME:
        raise SecurityError(
            f"{common_name}: expected at most {MAX_NAME} characters in a certificate's name; choose shorter names"
        )
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _usage(*, digital_signature: bool, key_cert_sign: bool = False, crl_sign: bool = False) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=digital_signature,
        key_cert_sign=key_cert_sign,
        crl_sign=crl_sign,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _write_certificate(path: Path, identity: Identity) -> None:
    path.write_bytes(identity.certificate.public_bytes(serialization.Encoding.PEM))


def _write_key(path: Path, identity: Identity) -> None:
    """The private key, for the owner's eyes alone from the first byte on."""
    text = identity.key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(text)


def _write_signed(path: Path, document: bytes, signer: Identity) -> None:
    """The document, and beside it the same signed as S/MIME in clear text, which is what DDS Security reads."""
    path.write_bytes(document)
    builder = pkcs7.PKCS7SignatureBuilder().set_data(document)
    builder = builder.add_signer(signer.certificate, signer.key, hashes.SHA256())
    options = [pkcs7.PKCS7Options.Text, pkcs7.PKCS7Options.DetachedSignature]
    path.with_suffix(".p7s").write_bytes(builder.sign(serialization.Encoding.SMIME, options))


def _link(folder: Path, target: Path) -> None:
    (folder / target.name).symlink_to(os.path.relpath(target, folder))
