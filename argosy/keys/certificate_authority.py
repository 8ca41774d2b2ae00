"""The fleet's certificate authority: one secret key that signs all certificates (docs/guides/security.md).

A machine accepts a certificate that was signed by one of the *anchors* in its `ca.pem`. All anchors hold the public key
of the authority, each under its own name: one for each machine of the fleet. A machine is revoked by removing its
anchor from the `ca.pem` of all others; Zenoh does not support revocation lists.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

ANCHOR_DAYS = 20 * 365
"""Validity of an anchor: in practice it ends when it is removed."""
BACK_DAYS = 2 * 365
"""How far in the past certificates begin: a board without a real-time clock starts in the past."""
_DNS = re.compile(
    r"(?:[A-Za-z0-9_](?:[A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?\.)*[A-Za-z0-9_](?:[A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?"
)


@dataclass(frozen=True)
class Machine:
    """The subject of a certificate."""

    fleet: str
    name: str
    generation: int
    """Counts the machines that had this name, from 1; a revoked one is replaced by the next."""
    serves: bool
    """Whether others dial it: true for boards, false for operators and observers."""
    addresses: tuple[str, ...]
    """Its host names and IP addresses."""


@dataclass(frozen=True)
class Pair:
    """A certificate and its key, in PEM."""

    certificate: bytes
    key: bytes


class Authority:
    """Signs certificates with the fleet's key."""

    def __init__(self, key: ec.EllipticCurvePrivateKey, now: datetime | None = None) -> None:
        self._key, self._now = key, now or datetime.now(UTC)

    @classmethod
    def new(cls) -> Authority:
        """Generate a fleet's key."""
        return cls(ec.generate_private_key(ec.SECP256R1()))

    @classmethod
    def read(cls, pem: bytes, password: bytes | None) -> Authority:
        """Read a fleet's key. Raises ValueError, and TypeError if a password is missing or not needed."""
        key = serialization.load_pem_private_key(pem, password)
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            raise ValueError("expected a key on an elliptic curve")
        return cls(key)

    def at(self, now: datetime) -> Authority:
        """Return the authority with another present time."""
        return Authority(self._key, now)

    def secret(self, password: bytes | None) -> bytes:
        """Return the key in PEM, encrypted if there is a password."""
        lock = serialization.BestAvailableEncryption(password) if password else serialization.NoEncryption()
        return _key_pem(self._key, lock)

    def anchor(self, machine: Machine) -> bytes:
        """Return a machine's anchor in PEM: whoever has it accepts that machine."""
        usage = x509.KeyUsage(False, False, False, False, False, True, True, False, False)  # signs certificates
        name, key = _anchor_name(machine), self._key.public_key()
        made = (
            self._begun(name, name, key, self._now + timedelta(days=ANCHOR_DAYS))
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(usage, critical=True)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
            .sign(self._key, hashes.SHA256())
        )
        return made.public_bytes(serialization.Encoding.PEM)

    def certify(self, machine: Machine, ends: datetime) -> Pair:
        """Generate a machine's key and certificate, valid until `ends`. Raises ValueError for an invalid address."""
        key = ec.generate_private_key(ec.SECP256R1())
        signs = x509.KeyUsage(True, False, False, False, False, False, False, False, False)
        uses = [ExtendedKeyUsageOID.CLIENT_AUTH, *([ExtendedKeyUsageOID.SERVER_AUTH] if machine.serves else [])]
        issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(self._key.public_key())
        made = (
            self._begun(_own_name(machine), _anchor_name(machine), key.public_key(), ends)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(signs, critical=True)
            .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
            .add_extension(issuer, critical=False)
        )
        if machine.addresses:
            names = x509.SubjectAlternativeName(list(map(_general_name, machine.addresses)))
            made = made.add_extension(names, critical=False)
        signed = made.sign(self._key, hashes.SHA256())
        return Pair(signed.public_bytes(serialization.Encoding.PEM), _key_pem(key, serialization.NoEncryption()))

    def _begun(
        self, subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, ends: datetime
    ) -> x509.CertificateBuilder:
        return (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(issuer)
            .public_key(key)
            .serial_number(x509.random_serial_number())
            .not_valid_before(self._now - timedelta(days=BACK_DAYS))
            .not_valid_after(ends)
        )


def is_host(text: str) -> bool:
    """Whether a certificate can be for this: an IP address, or a host name in ASCII."""
    try:
        _general_name(text)
    except ValueError:
        return False
    return True


def _own_name(machine: Machine) -> x509.Name:
    parts = {NameOID.ORGANIZATION_NAME: machine.fleet, NameOID.COMMON_NAME: machine.name}
    return x509.Name([x509.NameAttribute(kind, text) for kind, text in parts.items()])


def _anchor_name(machine: Machine) -> x509.Name:
    which = x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, f"keys {machine.generation}")
    return x509.Name([which, *_own_name(machine)])


def _general_name(address: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(address))
    except ValueError:
        if _DNS.fullmatch(address) is None:
            raise ValueError(f"expected a host name or an IP address, got `{address}`") from None
        return x509.DNSName(address)


def _key_pem(key: ec.EllipticCurvePrivateKey, lock: serialization.KeySerializationEncryption) -> bytes:
    return key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, lock)
