"""A signed export is accepted in the form in which it was signed, and in no other form."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from ssm_planner.errors import ExportError
from ssm_planner.formats.export import export
from ssm_planner.plans import Plan
from ssm_planner.publishing import MANIFEST, file_hashes
from tests.support.cli import run
from tests.support.paths import PROBLEMS

pytest.importorskip("cryptography", reason="the package cryptography (extra sign) signs exports")
ROBOT = str(PROBLEMS / "robots/vitreoretinal.yaml")


def keys(folder: Path, name: str) -> tuple[Path, Path]:
    """Write a new private key and its public key, and return their files."""
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    key = Ed25519PrivateKey.generate()
    pem, form = serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    private, public = folder / f"{name}.pem", folder / f"{name}_public.pem"
    secret = key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    private.write_bytes(secret)
    public.write_bytes(key.public_key().public_bytes(pem, form))
    return private, public


@pytest.fixture(scope="module")
def signed(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a signed export and the public key."""
    root = tmp_path_factory.mktemp("signed")
    private, public = keys(root, "key")
    export(plan, "csv", root / "csv", sign=private)
    return root / "csv", public


Checked = Callable[[Path, Path], tuple[int, dict]]


@pytest.fixture
def checked(capsys: pytest.CaptureFixture[str]) -> Checked:
    """Return a function that checks a folder with a key, and returns exit status and output."""

    def check(folder: Path, key: Path) -> tuple[int, dict]:
        status = run("check", folder, "--robot", ROBOT, "--key", key, "--json")
        return status, json.loads(capsys.readouterr().out)

    return check


def test_the_folder_that_was_signed_is_accepted(
    signed: tuple[Path, Path], checked: Checked
) -> None:
    status, document = checked(*signed)
    assert (status, document["passed"]) == (0, True)


def edited(key: str, value: object) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        manifest[key] = value
        (folder / MANIFEST).write_text(json.dumps(manifest), encoding="utf-8")

    return change


def table_changed(folder: Path) -> None:
    """Change the table and update its hash in the manifest."""
    path = folder / "trajectory.csv"
    path.write_text(path.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    edited("files", file_hashes(folder))(folder)


CHANGES: dict[str, tuple[Callable[[Path], None], str]] = {
    "unsigned": (edited("signature", None), "the folder is not signed"),
    "signature": (edited("signature", "00" * 64), "the manifest was changed, or the signature"),
    "no number": (edited("signature", "xyz"), "the manifest was changed, or the signature"),
    "version": (edited("software", {"ssm-planner": "0"}), "the manifest was changed, or the sig"),
    "note": (edited("notes", []), "the manifest was changed, or the signature"),
    "table and hash": (table_changed, "the manifest was changed, or the signature"),
    "table": (lambda folder: (folder / "trajectory.csv").write_text("x"), "trajectory.csv was cha"),
    "added": (lambda folder: (folder / "tilt.csv").write_text("x"), "tilt.csv was changed after"),
    "no table": (lambda folder: (folder / "trajectory.csv").unlink(), "trajectory.csv was changed"),
    "no manifest": (lambda folder: (folder / MANIFEST).unlink(), "not a rosbag2 and not an export"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_any_other_folder_fails(
    signed: tuple[Path, Path], checked: Checked, tmp_path: Path, name: str
) -> None:
    change, reason = CHANGES[name]
    shutil.copytree(signed[0], tmp_path / "x")
    change(tmp_path / "x")
    status, document = checked(tmp_path / "x", signed[1])
    assert (status, document["passed"], document["verdict"]) == (1, False, "violated")
    assert reason in document["reason"]


def test_another_key_does_not_confirm_the_folder(
    signed: tuple[Path, Path], checked: Checked, tmp_path: Path
) -> None:
    private, public = keys(tmp_path, "other")
    assert checked(signed[0], public)[0] == 1
    for key in (private, signed[0] / MANIFEST):
        with pytest.raises(ExportError, match="not an Ed25519 public key"):
            checked(signed[0], key)
    with pytest.raises(ExportError, match=r"none\.pem: cannot be read"):
        checked(signed[0], tmp_path / "none.pem")


def test_a_bad_key_writes_nothing(plan: Plan, signed: tuple[Path, Path], tmp_path: Path) -> None:
    faults = {
        signed[1]: "not an Ed25519 private key",
        tmp_path / "none.pem": r"none\.pem: cannot be read",
    }
    for key, fault in faults.items():
        with pytest.raises(ExportError, match=fault):
            export(plan, "csv", tmp_path / "csv", sign=key)
    assert not list(tmp_path.iterdir())
