"""A certificate authority of the robot's own, and a certificate for its page, so that a headset can trust it.

WebCodecs, WebXR and device orientation exist on secure pages only, and browsers close a secure socket to an untrusted
one without a word.
"""

from __future__ import annotations

import datetime
import ipaddress
import os
import socket
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from ghal360_robot.errors import GhalError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

AUTHORITY_DAYS = 3650
PAGE_DAYS = 397
"""The longest that Apple's browsers accept."""

BACKDATED = datetime.timedelta(days=1)
"""For a headset whose clock is behind."""

MAX_NAME = 253


@dataclass(frozen=True, slots=True)
class Made:
    """Files written: `authority` goes onto the headset, the other two into `[page]`."""

    authority: Path
    certificate: Path
    key: Path
    names: tuple[str, ...]
    new_authority: bool
    """Whether devices have to be told of it."""


def own_names() -> tuple[str, ...]:
    """What this machine is called, as far as it knows itself."""
    host = socket.gethostname()
    names = ["localhost", "127.0.0.1", "::1", host, f"{host.split('.')[0]}.local"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing: it only asks which of our addresses faces outwards
            names.append(probe.getsockname()[0])
        except OSError:
            pass  # no network: the names have to do
    return tuple(dict.fromkeys(names))


def make(folder: Path, names: Iterable[str]) -> Made:
    """Write `ca.crt`, `ca.key`, `page.crt`, `page.key`; an authority that is there already signs again.

    Raises UsageError for a name that is none, GhalError where files cannot be written or the old authority is damaged.
    """
    names = tuple(dict.fromkeys(names))
    alternatives = [_alternative(name) for name in names]
    paths = {name: folder / name for name in ("ca.crt", "ca.key", "page.crt", "page.key")}
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        known = paths["ca.crt"].exists() and paths["ca.key"].exists()
        authority, authority_key = _load(paths) if known else _new_authority(paths)
        key = ec.generate_private_key(ec.SECP256R1())
        page = _signed(
            subject=x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, names[0][:64])]),
            issuer=authority.subject,
            key=key,
            signer=authority_key,
            days=PAGE_DAYS,
            extensions=(
                (x509.BasicConstraints(ca=False, path_length=None), True),
                (x509.SubjectAlternativeName(alternatives), False),
                (x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), False),
                (x509.AuthorityKeyIdentifier.from_issuer_public_key(authority_key.public_key()), False),
            ),
        )
        paths["page.crt"].write_bytes(_pem(page) + _pem(authority))
        _write_key(paths["page.key"], key)
    except OSError as error:
        raise GhalError(f"cannot write certificates to {folder}: {error.strerror}") from error
    return Made(paths["ca.crt"], paths["page.crt"], paths["page.key"], names, not known)


def _alternative(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        pass
    allowed = all(part and part.replace("-", "").isalnum() and part.isascii() for part in name.split("."))
    if not allowed or len(name) > MAX_NAME:
        raise UsageError(f"'{name}' is neither a host name nor an address")
    return x509.DNSName(name.lower())


def _new_authority(paths: dict[str, Path]) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"ghal360-robot on {socket.gethostname()}"[:64])])
    usage = x509.KeyUsage(
        digital_signature=False,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=True,
        crl_sign=True,
        encipher_only=False,
        decipher_only=False,
    )
    authority = _signed(
        subject=name,
        issuer=name,
        key=key,
        signer=key,
        days=AUTHORITY_DAYS,
        extensions=(
            (x509.BasicConstraints(ca=True, path_length=0), True),
            (usage, True),
            (x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False),
        ),
    )
    _write_key(paths["ca.key"], key)
    paths["ca.crt"].write_bytes(_pem(authority))
    return authority, key


def _load(paths: dict[str, Path]) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    try:
        authority = x509.load_pem_x509_certificate(paths["ca.crt"].read_bytes())
        key = serialization.load_pem_private_key(paths["ca.key"].read_bytes(), None)
    except (ValueError, TypeError) as error:
        raise GhalError(
            f"{paths['ca.crt']} or {paths['ca.key']} is damaged: delete both for a new authority"
        ) from error
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != authority.public_key():
        raise GhalError(f"{paths['ca.key']} is not the key of {paths['ca.crt']}: delete both for a new authority")
    return authority, key


def _signed(
    *,
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    signer: ec.EllipticCurvePrivateKey,
    days: int,
    extensions: Iterable[tuple[x509.ExtensionType, bool]],
) -> x509.Certificate:
    now = datetime.datetime.now(datetime.UTC)
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - BACKDATED)
        .not_valid_after(now + datetime.timedelta(days=days) - BACKDATED)
    )
    for extension, critical in extensions:
        builder = builder.add_extension(extension, critical)
    return builder.sign(signer, hashes.SHA256())


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _write_key(path: Path, key: ec.EllipticCurvePrivateKey) -> None:
    """For its owner alone, from the first byte on."""
    text = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(text)
