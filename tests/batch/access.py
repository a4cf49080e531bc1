"""Writes what NATS servers and workers need to trust one another.

usage: access.py FOLDER

ca.pem, server.pem and server.key are of an authority and of a server at 127.0.0.1; other-ca.pem is of another authority.
operator.conf is for a server whose users have credentials (JWT, signed with Ed25519), worker.creds those of one of them, and
foreign.creds those of a user whom nobody has let in.
"""

import base64
import datetime
import ipaddress
import json
import pathlib
import sys

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519
from cryptography.x509.oid import NameOID

FOLDER = pathlib.Path(sys.argv[1])
OPERATOR, ACCOUNT, USER = 14 << 3, 0, 20 << 3
SEED = 18 << 3


def certificate(name, key, issuer, signer, extension):
    now = datetime.datetime.now(datetime.timezone.utc)
    builder = x509.CertificateBuilder().subject_name(name).issuer_name(issuer).public_key(key.public_key())
    builder = builder.serial_number(x509.random_serial_number()).not_valid_before(now - datetime.timedelta(hours=1))
    builder = builder.not_valid_after(now + datetime.timedelta(days=1)).add_extension(*extension)
    return builder.sign(signer, hashes.SHA256())


def named(name):
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def pem(what):
    return what.public_bytes(serialization.Encoding.PEM)


def authority(name):
    key = ec.generate_private_key(ec.SECP256R1())
    extension = (x509.BasicConstraints(ca=True, path_length=None), True)
    return key, certificate(named(name), key, named(name), key, extension)


def certificates():
    signer, own = authority("one authority")
    (FOLDER / "ca.pem").write_bytes(pem(own))
    (FOLDER / "other-ca.pem").write_bytes(pem(authority("another authority")[1]))
    key = ec.generate_private_key(ec.SECP256R1())
    names = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    server = certificate(named("server"), key, named("one authority"), signer, (names, False))
    (FOLDER / "server.pem").write_bytes(pem(server))
    plain = serialization.NoEncryption()
    form = serialization.PrivateFormat.PKCS8
    (FOLDER / "server.key").write_bytes(key.private_bytes(serialization.Encoding.PEM, form, plain))


def checked(data):
    """With its CRC-16 (XMODEM), in base32."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x1021 if crc & 0x8000 else 0)
            crc &= 0xFFFF
    return base64.b32encode(data + crc.to_bytes(2, "little")).decode().rstrip("=")


class Key:
    def __init__(self, kind):
        self.key = ed25519.Ed25519PrivateKey.generate()
        self.name = checked(bytes([kind]) + self.key.public_key().public_bytes_raw())
        self.seed = checked(bytes([SEED | kind >> 5, (kind & 31) << 3]) + self.key.private_bytes_raw())

    def claim(self, subject, name, nats):
        """A claim about a user, signed with this key."""
        body = {"jti": name, "iat": 1700000000, "iss": self.name, "name": name, "sub": subject, "nats": {**nats, "version": 2}}
        parts = [{"typ": "JWT", "alg": "ed25519-nkey"}, body]
        text = ".".join(base64.urlsafe_b64encode(json.dumps(part).encode()).decode().rstrip("=") for part in parts)
        return f"{text}.{base64.urlsafe_b64encode(self.key.sign(text.encode())).decode().rstrip('=')}"


def credentials(account, file):
    user = Key(USER)
    claim = account.claim(user.name, "worker", {"type": "user", "pub": {}, "sub": {}, "subs": -1, "data": -1, "payload": -1})
    (FOLDER / file).write_text(
        f"-----BEGIN NATS USER JWT-----\n{claim}\n------END NATS USER JWT------\n\n"
        f"-----BEGIN USER NKEY SEED-----\n{user.seed}\n------END USER NKEY SEED------\n"
    )


def operator():
    own, system, account = Key(OPERATOR), Key(ACCOUNT), Key(ACCOUNT)
    plain = {name: -1 for name in ["subs", "data", "payload", "imports", "exports", "conn", "leaf"]}
    stored = {name: -1 for name in ["mem_storage", "disk_storage", "streams", "consumer"]}
    claims = {
        system.name: own.claim(system.name, "system", {"type": "account", "limits": {**plain, "wildcards": True}}),
        account.name: own.claim(account.name, "jobs", {"type": "account", "limits": {**plain, **stored, "wildcards": True}}),
    }
    preload = "\n".join(f"  {name}: {claim}" for name, claim in claims.items())
    (FOLDER / "operator.conf").write_text(
        f"operator: {own.claim(own.name, 'operator', {'type': 'operator'})}\nsystem_account: {system.name}\n"
        f"resolver: MEMORY\nresolver_preload: {{\n{preload}\n}}\n"
    )
    credentials(account, "worker.creds")
    credentials(Key(ACCOUNT), "foreign.creds")


certificates()
operator()
