"""Sign the manifest of an export with Ed25519 (RFC 8032), and verify the signature.

The signature covers the whole manifest, which contains the hashes of the plan, of the robot and of
all files, and the versions of the program. `sign_manifest` creates the signature, and
`signature_error` verifies it.
"""

import json
from pathlib import Path
from typing import Any

from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.read import read_manifest
from ssm_planner.publishing import file_hashes
from ssm_planner.typing import JsonObject

SIGNATURE = "signature"
"""Key of the signature in the manifest."""


def sign_manifest(manifest: JsonObject, key: Path) -> str:
    """Sign the manifest of an export.

    Parameters
    ----------
    manifest : dict
        Manifest of an export. An existing signature in it is ignored.
    key : Path
        PEM file with an Ed25519 private key.

    Returns
    -------
    str
        Signature in hexadecimal.

    Raises
    ------
    ExportError
        If the key cannot be used, or if the package cryptography is not installed.
    """
    return str(_read_key(key, "private").sign(_signed_bytes(manifest)).hex())


def signature_error(folder: Path, key: Path) -> str | None:
    """Return the reason why the signature of an export folder is invalid, or None.

    The signature must belong to the manifest, and the files must have the hashes in the manifest.

    Parameters
    ----------
    folder : Path
        Export folder.
    key : Path
        PEM file with the Ed25519 public key.

    Returns
    -------
    str or None
        Reason such as a missing manifest or a changed file, or None if the signature is valid.

    Raises
    ------
    ExportError
        If the key cannot be used, or if the package cryptography is not installed.
    """
    public = _read_key(key, "public")
    from cryptography.exceptions import InvalidSignature

    try:
        manifest = read_manifest(folder)
    except TrajectoryError as error:
        return str(error)
    signature = manifest.get(SIGNATURE)
    if not isinstance(signature, str):
        return "the folder is not signed"
    try:
        public.verify(bytes.fromhex(signature), _signed_bytes(manifest))
    except (InvalidSignature, ValueError):
        return f"the manifest was changed, or the signature belongs to another key than {key}"
    # The symmetric difference contains the changed, missing and additional files.
    changes = set(file_hashes(folder).items()) ^ set(manifest["files"].items())
    return f"{min(changes)[0]} was changed after the signature" if changes else None


def _signed_bytes(manifest: JsonObject) -> bytes:
    """Return the bytes that the signature covers: the manifest without its signature.

    They are JSON with sorted keys and no spaces, so they do not depend on the layout of the file.
    """
    signed = {key: value for key, value in manifest.items() if key != SIGNATURE}
    return json.dumps(signed, sort_keys=True, separators=(",", ":")).encode()


def _read_key(path: Path, key_type: str) -> Any:
    """Read an Ed25519 key from a PEM file.

    Parameters
    ----------
    path : Path
        File of the key, without a password.
    key_type : str
        "private" or "public".

    Returns
    -------
    Ed25519PrivateKey or Ed25519PublicKey
        The key.

    Raises
    ------
    ExportError
        If the file cannot be read or does not contain such a key, or if the package cryptography is
        not installed.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ExportError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        from cryptography.exceptions import UnsupportedAlgorithm
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ImportError as error:
        raise ExportError(
            "signatures need the package cryptography: pip install 'ssm-planner[sign]'"
        ) from error
    try:
        if key_type == "private":
            key: Any = serialization.load_pem_private_key(data, None)
        else:
            key = serialization.load_pem_public_key(data)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, (ed25519.Ed25519PrivateKey, ed25519.Ed25519PublicKey)):
        raise ExportError(f"{path}: not an Ed25519 {key_type} key (allowed: PEM without password)")
    return key
