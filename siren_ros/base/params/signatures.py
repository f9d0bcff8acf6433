"""Signs files with an examiner's key, and checks signatures: Ed25519 (RFC 8032) over a file's bytes.

The signature of ``NAME`` is ``NAME.sig``: 64 bytes, as ``openssl pkeyutl -sign -rawin`` writes them. Keys are PEM files
(``openssl genpkey -algorithm ed25519``; ``openssl pkey -pubout`` gives the public one).
"""

from importlib import import_module
from pathlib import Path
from typing import Any, Final

from siren_ros.errors import InputError, whole_file, writing

_SUFFIX: Final = ".sig"


def private_key(file: Path) -> Any:
    """The private key in a PEM file; InputError if it has none of Ed25519, or needs a password."""
    return _key(file, "private", "load_pem_private_key", password=None)


def sign(file: Path, key: Any) -> Path:
    """Write the signature of a file beside it; InputError where it cannot be written."""
    signature = file.with_name(file.name + _SUFFIX)
    with writing(signature), whole_file(signature) as new:
        new.write_bytes(key.sign(file.read_bytes()))
    return signature


def fault_of_signature(file: Path, public_key: Path) -> str:
    """Why a file is not signed by the owner of a key; empty if it is.

    Raises:
        InputError: There is no public key of Ed25519, or the package ``cryptography`` is not installed.
    """
    key = _key(public_key, "public", "load_pem_public_key")
    try:
        key.verify(file.with_name(file.name + _SUFFIX).read_bytes(), file.read_bytes())
    except OSError as error:
        return f"{file.name} is not signed ({error.strerror or error})"
    except _module("exceptions").InvalidSignature:
        return f"{file.name} is not what the owner of {public_key.name} signed"
    return ""


def _key(file: Path, kind: str, load: str, **how: None) -> Any:
    wanted = getattr(_module("hazmat.primitives.asymmetric.ed25519"), f"Ed25519{kind.capitalize()}Key")
    try:
        key = getattr(_module("hazmat.primitives.serialization"), load)(file.read_bytes(), **how)
    except (OSError, ValueError, TypeError, _module("exceptions").UnsupportedAlgorithm) as error:
        key = error
    if not isinstance(key, wanted):
        raise InputError("key", str(file), f"a PEM file with a {kind} key of Ed25519")
    return key


def _module(name: str) -> Any:
    try:
        return import_module(f"cryptography.{name}")
    except ModuleNotFoundError as error:
        raise InputError("sign", "", "`./env --with sign siren …`, which installs cryptography") from error
