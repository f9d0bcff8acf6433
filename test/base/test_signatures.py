"""Signatures of files: who signed what, and what was altered."""

import subprocess
from pathlib import Path

import pytest
from signing_keys import made_keys

from siren_ros.base.params.signatures import fault_of_signature, private_key, sign
from siren_ros.errors import InputError


def test_a_signature_is_of_one_owner_and_of_these_bytes(tmp_path: Path) -> None:
    (private, public), (_, others) = made_keys(tmp_path, "examiner"), made_keys(tmp_path, "other")
    file = tmp_path / "certificate.json"
    file.write_text("passed: false")
    assert "not signed" in fault_of_signature(file, public)
    signature = sign(file, private_key(private))
    assert len(signature.read_bytes()) == 64
    assert fault_of_signature(file, public) == ""
    assert "other_public.pem signed" in fault_of_signature(file, others)
    file.write_text("passed: true ")
    assert "examiner_public.pem signed" in fault_of_signature(file, public)
    sign(file, private_key(made_keys(tmp_path, "forger")[0]))
    assert "examiner_public.pem signed" in fault_of_signature(file, public)


def test_openssl_checks_the_same_signature(tmp_path: Path) -> None:
    private, public = made_keys(tmp_path, "examiner")
    file = tmp_path / "board.json"
    file.write_bytes(bytes(range(256)))
    words = ["openssl", "pkeyutl", "-verify", "-rawin", "-pubin", "-inkey", str(public), "-in", str(file)]
    words += ["-sigfile", str(sign(file, private_key(private)))]
    try:
        done = subprocess.run(words, capture_output=True, check=False, timeout=60)
    except FileNotFoundError:
        pytest.skip("OpenSSL is not installed")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("content", [b"", b"-----BEGIN PRIVATE KEY-----", b"public"])
def test_what_is_no_key_is_refused(tmp_path: Path, content: bytes) -> None:
    private, public = made_keys(tmp_path, "examiner")
    file = tmp_path / "key.pem"
    file.write_bytes(public.read_bytes() if content == b"public" else content)
    with pytest.raises(InputError, match="a private key of Ed25519"):
        private_key(file)
    with pytest.raises(InputError, match="a public key of Ed25519"):
        fault_of_signature(file, private)
