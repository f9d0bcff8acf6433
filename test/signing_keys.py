"""Keys of examiners, for tests of what they sign."""

from pathlib import Path

import pytest


def made_keys(folder: Path, name: str) -> tuple[Path, Path]:
    """A private and a public key of Ed25519 as PEM files; the test is skipped without the extra ``sign``."""
    forms = pytest.importorskip("cryptography.hazmat.primitives.serialization", reason="the extra sign")
    kinds = pytest.importorskip("cryptography.hazmat.primitives.asymmetric.ed25519", reason="the extra sign")
    key = kinds.Ed25519PrivateKey.generate()
    private, public = folder / f"{name}.pem", folder / f"{name}_public.pem"
    pem, plain = forms.Encoding.PEM, forms.PrivateFormat.PKCS8
    private.write_bytes(key.private_bytes(pem, plain, forms.NoEncryption()))
    public.write_bytes(key.public_key().public_bytes(pem, forms.PublicFormat.SubjectPublicKeyInfo))
    return private, public
