"""Publish the files of a result folder such that they always belong to one plan.

A generation consists of all files that belong to one plan. The program writes them to a temporary
folder. It then writes a manifest.json with the hash of every file and a mark of incompleteness to
the result folder, moves the files there, and finally writes the manifest without the mark. After an
interruption, the folder either contains one generation, or its mark shows that it does not.
"""

import hashlib
import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath

from ssm_planner.atomic import (
    flush_to_disk,
    held_signals,
    locked,
    replacing,
    resolve_destination,
    staging,
    written_files,
)
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.typing import JsonObject

MANIFEST = "manifest.json"
PLAN_FILE = "plan.json"
EXPORT_FORMAT = "ssm_planner export"
"""Value of the key `format` in the manifest of an export folder."""
RESULT_FORMAT = "ssm_planner results"
"""Value of the key `format` in the manifest of a result folder."""
MANIFEST_VERSION = 1
"""Version of the format of a manifest."""
INCOMPLETE_KEY = "incomplete"
"""Key of a manifest whose folder is being changed."""
LARGEST_MANIFEST_SIZE = 64 * 2**20
"""Largest size of a manifest in bytes."""
LONGEST_NAME = 100
"""Largest number of characters of a file name."""


def file_name(text: str) -> str:
    """Convert a name from data to a file name that cannot select another folder.

    Characters other than ASCII letters, digits, `-`, `_` and `.` are replaced by `_`.
    """
    cleaned = "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "_" for c in text)
    return cleaned.lstrip(".")[:LONGEST_NAME] or "unnamed"


def one_line(text: str, without: str = "") -> str:
    """Convert a name from data to text for a comment or title, on one line.

    Characters that are not printable or are in `without` are replaced by `_`.
    """
    return "".join(c if c.isprintable() and c not in without else "_" for c in text)


@contextmanager
def publishing(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder whose content is moved into `folder` at the end of the block.

    A manifest.json in the temporary folder lists the files (`files`: name → SHA-256). Files of an
    earlier generation that are not in the new one are removed unless they were changed. Other files
    remain. If the block raises an exception, nothing changes. Raises ExportError, without any
    change, if the folder cannot be written, if it is not a folder of results, or if it contains a
    file with the name of a new file that no export wrote.
    """
    with staging(folder) as temporary:
        yield temporary
        _publish(temporary, resolve_destination(folder, file_type_wanted=stat.S_IFDIR), folder)


@contextmanager
def publishing_results(folder: Path, plan: str | None = None) -> Iterator[Path]:
    """Yield a temporary folder like `publishing`, for files made from one plan.

    If a plan.json is among the files, they form a new generation. Otherwise they are added to the
    files of the plan whose SHA-256 is `plan`. Raises ExportError if the folder contains another
    plan.
    """
    with publishing(folder) as temporary:
        yield temporary
        files = file_hashes(temporary)
        sha = files.get(PLAN_FILE, plan)
        manifest = {
            "format": RESULT_FORMAT,
            "version": MANIFEST_VERSION,
            "plan": sha,
            "files": files,
        }
        _write_manifest(temporary / MANIFEST, manifest)


@contextmanager
def replacing_result(path: Path, plan: str) -> Iterator[Path]:
    """Yield a path like `replacing` for a file made from one plan.

    The SHA-256 of the plan is `plan`. In the result folder of this plan, the manifest is updated.
    """
    if read_manifest(path.parent).get("format") != RESULT_FORMAT:
        with replacing(path) as temporary:
            yield temporary
        return
    with publishing_results(path.parent, plan) as folder:
        yield folder / path.name


def file_hashes(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file below a folder except the manifest, by relative path."""
    manifest = folder / MANIFEST
    return {
        path.relative_to(folder).as_posix(): sha256(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path != manifest
    }


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(2**20):
            digest.update(block)
    return digest.hexdigest()


def read_manifest(folder: Path) -> JsonObject:
    """Read the manifest of a result or export folder.

    The mapping is empty without a valid manifest.
    """
    path = folder / MANIFEST
    try:
        if not path.is_file() or path.stat().st_size > LARGEST_MANIFEST_SIZE:
            return {}
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if isinstance(document, dict) and document.get("format") in (EXPORT_FORMAT, RESULT_FORMAT):
        return document
    return {}


def listed_files(manifest: JsonObject) -> dict[str, str]:
    """Return the SHA-256 of each file that a manifest lists, by name.

    Names that lead out of its folder are omitted.
    """
    files = manifest.get("files")
    if not isinstance(files, dict):
        return {}
    return {name: str(sha) for name, sha in files.items() if is_inside(name)}


def check_generation(folder: Path) -> None:
    """Raise TrajectoryError if a file in a folder differs from the one that its manifest lists.

    Folders without a manifest are accepted, and so are missing files.
    """
    manifest = read_manifest(folder)
    if manifest.get(INCOMPLETE_KEY):
        raise TrajectoryError(
            f"{folder}: publishing was interrupted, so the files may be of two plans: make them "
            "again"
        )
    for name, sha in listed_files(manifest).items():
        if os.path.exists(folder / name) and not _has_hash(folder / name, sha):
            raise TrajectoryError(
                f"{folder / name}: is not the file that {MANIFEST} lists; re-create the results, "
                f"or remove {MANIFEST} if you changed the file yourself"
            )


def _publish(source: Path, folder: Path, displayed_path: Path) -> None:
    """Rename a temporary folder to its final name, or move its files into an existing folder.

    `displayed_path` is the path of the folder as the user wrote it, for messages.
    """
    flush_to_disk(source)
    with held_signals():
        if not folder.exists():
            with suppress(OSError):  # another process was faster
                source.rename(folder)
                flush_to_disk(folder.parent, content=False)
                written_files.append(displayed_path)
                return
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder):
            _exchange(source, folder, displayed_path)
        written_files.append(displayed_path)


def _exchange(source: Path, folder: Path, displayed_path: Path) -> None:
    """Move the content of `source` into a folder. The files that it replaces are moved away first.

    Raises ExportError, before any change, if a file that no export wrote would be replaced.
    """
    manifest = read_manifest(source)
    present_manifest = read_manifest(folder)
    present_files = listed_files(present_manifest)
    file_format = manifest.get("format")
    if file_format:
        manifest = _combined_manifest(source, folder, displayed_path, manifest, present_manifest)
    new_files = listed_files(manifest)
    entries = sorted(path for path in source.iterdir() if path.name != MANIFEST)
    for entry in entries:
        _check_replaceable(
            folder / entry.name,
            displayed_path / entry.name,
            entry.is_dir(),
            present_files,
            strict=file_format == EXPORT_FORMAT,
        )
    replaced_folder = source / ".replaced"
    replaced_folder.mkdir()
    if file_format:
        marker = source / ".begun"
        all_files = present_files | new_files
        _write_manifest(marker, manifest | {INCOMPLETE_KEY: True, "files": all_files})
        marker.replace(folder / MANIFEST)
        flush_to_disk(folder, content=False)
    for entry in entries:
        target = folder / entry.name
        if entry.is_dir() and target.exists():
            target.rename(replaced_folder / entry.name)
        entry.replace(target)
    if file_format:
        stale_files = {name: sha for name, sha in present_files.items() if name not in new_files}
        _remove_stale(folder, stale_files)
        flush_to_disk(folder, content=False)
        (source / MANIFEST).replace(folder / MANIFEST)
    flush_to_disk(folder, content=False)


def _combined_manifest(
    source: Path,
    folder: Path,
    displayed_path: Path,
    manifest: JsonObject,
    present_manifest: JsonObject,
) -> JsonObject:
    """Return the manifest of the new generation.

    Files without a plan.json are added to the unchanged files of the same plan.

    Parameters
    ----------
    source, folder : Path
        Temporary folder with the new files, and folder into which they will be moved.
    displayed_path : Path
        Path of the folder for messages.
    manifest, present_manifest : dict
        Manifests of the new files, and of the files in the folder.

    Raises
    ------
    ExportError
        If the folder contains files of another format or another plan.
    """
    if not present_manifest:
        return manifest
    hint = "choose another folder (nothing was written)"
    present_format = present_manifest["format"]
    if present_format != manifest["format"]:
        description = "an export" if present_format == EXPORT_FORMAT else "the results of a plan"
        raise ExportError(f"{displayed_path}: holds {description}: {hint}")
    if present_format != RESULT_FORMAT or PLAN_FILE in listed_files(manifest):
        return manifest
    if present_manifest.get("plan") != manifest["plan"]:
        raise ExportError(f"{displayed_path}: holds results of another plan: {hint}")
    files = {
        name: sha
        for name, sha in listed_files(present_manifest).items()
        if _has_hash(folder / name, sha)
    }
    files |= manifest["files"]
    manifest["files"] = dict(sorted(files.items()))
    _write_manifest(source / MANIFEST, manifest)
    return manifest


def _write_manifest(path: Path, manifest: JsonObject) -> None:
    """Write a manifest and flush it to the disk."""
    path.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    flush_to_disk(path)


def _check_replaceable(
    target: Path,
    displayed_path: Path,
    is_folder: bool,
    present_files: Mapping[str, str],
    strict: bool,
) -> None:
    """Raise ExportError if a file that no export wrote would be replaced.

    Parameters
    ----------
    target : Path
        File or folder that would be replaced.
    displayed_path : Path
        Its path for messages.
    is_folder : bool
        True if a folder replaces it.
    present_files : Mapping
        Hashes of the files that the present manifest lists, by name.
    strict : bool
        True if the new files are an export. Results may replace any single file.
    """
    if not os.path.lexists(target):
        return
    resolve_destination(target, file_type_wanted=stat.S_IFDIR if is_folder else stat.S_IFREG)
    files = [path for path in target.rglob("*") if not path.is_dir()] if is_folder else [target]
    for path in files:
        name = path.relative_to(target.parent).as_posix()
        if (strict or is_folder) and name not in present_files:
            raise ExportError(
                f"{displayed_path}: is in the way, and no export wrote {name}: choose another "
                "folder, or move it away; nothing is written"
            )


def _remove_stale(folder: Path, stale_files: Mapping[str, str]) -> None:
    """Remove the unchanged files of an earlier generation, and folders that become empty.

    `stale_files` contains the SHA-256 of the files by name.
    """
    for name, sha in stale_files.items():
        with suppress(OSError):
            if _has_hash(folder / name, sha):
                (folder / name).unlink()
                for parent in PurePosixPath(name).parents:
                    if parent != PurePosixPath("."):
                        (folder / parent).rmdir()


def _has_hash(path: Path, sha: str) -> bool:
    """Return True if a file exists and has this SHA-256."""
    return os.path.isfile(path) and sha256(path) == sha


def is_inside(name: str) -> bool:
    """Return True if a relative name stays inside its folder on every operating system."""
    if not name or "\0" in name or "\\" in name:
        return False
    path = PurePosixPath(name)
    return not path.is_absolute() and ".." not in path.parts
