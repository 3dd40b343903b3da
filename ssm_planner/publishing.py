"""Publish the files of a result folder such that they always belong to one plan.

A generation consists of all files that belong to one plan. The program writes them to a temporary
folder. It then writes a manifest.json with the hash of every file and a mark of incompleteness to
the result folder, moves the files there, and finally writes the manifest without the mark. After an
interruption, the folder either contains one generation, or its mark shows that it does not.

Exports, that is, files for other programs, are published in the same way.
"""

import hashlib
import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import BinaryIO

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
"""Name of the manifest, which lists the files of a folder with their SHA-256."""
PLAN_FILE = "plan.json"
"""Name of the file of a plan in its result folder."""
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
KIND_LENGTH = 12
"""Number of bytes at the beginning of a file that tell its kind, such as "# Friction i"."""
LONGEST_NAME = 100
"""Largest number of characters of a file name."""


def file_name(text: str) -> str:
    """Convert a name from data to a file name that cannot select another folder.

    Characters other than ASCII letters, digits, `-`, `_` and `.` are replaced by `_`. Dots at the
    beginning are removed, and the result has at most `LONGEST_NAME` characters.

    Parameters
    ----------
    text : str
        Name, for example that of a problem.

    Returns
    -------
    str
        File name, or "unnamed" if no character remains.
    """
    cleaned = "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "_" for c in text)
    return cleaned.lstrip(".")[:LONGEST_NAME] or "unnamed"


def one_line(text: str, without: str = "") -> str:
    """Convert a name from data to text for a comment or title, on one line.

    Parameters
    ----------
    text : str
        Name, for example that of a problem.
    without : str
        Characters that the text must not contain, such as those that end a comment.

    Returns
    -------
    str
        The name, in which `_` replaces characters that are not printable or are in `without`.
    """
    return "".join(c if c.isprintable() and c not in without else "_" for c in text)


@contextmanager
def publishing(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder whose content is moved into a folder at the end of the `with` block.

    The block may write a manifest.json, which lists the files (`files`: name → SHA-256), into the
    temporary folder. The new files then replace those of an earlier generation. Files of the
    earlier generation that are not in the new one are removed, unless they were changed since. All
    other files in the folder remain. If the block raises an exception, nothing changes.

    Parameters
    ----------
    folder : Path
        Destination, which need not exist.

    Yields
    ------
    Path
        Temporary folder.

    Raises
    ------
    ExportError
        Without any change, if the folder cannot be written, if it contains files of another format
        or plan, or if files of the user would be replaced (`_check_replaceable`).
    """
    with staging(folder) as temporary:
        yield temporary
        _publish(temporary, resolve_destination(folder, file_type_wanted=stat.S_IFDIR), folder)


@contextmanager
def publishing_results(folder: Path, plan: str | None = None) -> Iterator[Path]:
    """Yield a temporary folder like `publishing`, for files made from one plan.

    If a plan.json is among the files, they form a new generation. Otherwise they are added to the
    files of the same plan in the folder. The function writes the manifest.

    Parameters
    ----------
    folder : Path
        Destination, which need not exist.
    plan : str, optional
        SHA-256 of the plan.json from which the files are made, if it is not among them.

    Yields
    ------
    Path
        Temporary folder.

    Raises
    ------
    ExportError
        If the folder contains another plan, and for the reasons of `publishing`.
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
def replacing_result(path: Path, plan: str, beginning: str = "") -> Iterator[Path]:
    """Yield a temporary path like `replacing`, for one file made from a plan.

    If the file is in a result folder, the manifest of this folder is updated.

    Parameters
    ----------
    path : Path
        Destination.
    plan : str
        SHA-256 of the plan.json.
    beginning : str
        Text with which all files of this kind begin, as for `replacing`.

    Yields
    ------
    Path
        Temporary path that the `with` block must write.

    Raises
    ------
    ExportError
        If the file cannot be written, or if its folder contains the results of another plan.
    """
    if read_manifest(path.parent).get("format") != RESULT_FORMAT:
        with replacing(path, beginning) as temporary:
            yield temporary
        return
    with publishing_results(path.parent, plan) as folder:
        yield folder / path.name


def file_hashes(folder: Path) -> dict[str, str]:
    """Compute the hash of every file below a folder, except the manifest of the folder.

    Parameters
    ----------
    folder : Path
        Folder whose subfolders are searched, too.

    Returns
    -------
    dict
        SHA-256 in hexadecimal by the path of the file relative to the folder.
    """
    manifest = folder / MANIFEST
    return {
        path.relative_to(folder).as_posix(): sha256(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path != manifest
    }


def sha256(path: Path) -> str:
    """Compute the SHA-256 of a file in hexadecimal, in blocks that need little memory."""
    with path.open("rb") as file:
        return sha256_of_open_file(file)


def sha256_of_open_file(file: BinaryIO) -> str:
    """Compute the SHA-256 of an open file from its beginning, in hexadecimal."""
    digest = hashlib.sha256()
    file.seek(0)
    while block := file.read(2**20):
        digest.update(block)
    return digest.hexdigest()


def read_manifest(folder: Path) -> JsonObject:
    """Read the manifest of a result folder or an export folder.

    Parameters
    ----------
    folder : Path
        Folder of the manifest.

    Returns
    -------
    dict
        Content of the manifest. It is empty if the manifest is missing, too large or invalid.
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
    """Return the hash of each file that a manifest lists.

    Names that lead out of the folder of the manifest are omitted.

    Parameters
    ----------
    manifest : dict
        Content of a manifest.

    Returns
    -------
    dict
        SHA-256 in hexadecimal by the name of the file.
    """
    files = manifest.get("files")
    if not isinstance(files, dict):
        return {}
    return {name: str(sha) for name, sha in files.items() if is_inside(name)}


def check_generation(folder: Path) -> None:
    """Check that the files in a folder are those that its manifest lists.

    Files of two plans in one folder would contradict each other. Folders without a manifest are
    accepted, and so are missing files.

    Parameters
    ----------
    folder : Path
        Result folder or export folder.

    Raises
    ------
    TrajectoryError
        If a file differs from the listed one, or if the mark of incompleteness shows that a process
        was interrupted while it moved files.
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

    Parameters
    ----------
    source : Path
        Temporary folder.
    folder : Path
        Destination without symbolic links.
    displayed_path : Path
        Destination as the user wrote it, for messages.

    Raises
    ------
    ExportError
        Before any change, if a file that no export wrote would be replaced, or if the folder
        contains files of another format or plan.
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
    """Move the content of a temporary folder into an existing folder.

    If the temporary folder has a manifest, the steps are:

    1. Write the manifest with the mark of incompleteness and the names of old and new files.
    2. Move the new files. Folders that they replace are first moved into the temporary folder.
    3. Remove the unchanged files of the earlier generation.
    4. Write the manifest without the mark.

    Parameters
    ----------
    source : Path
        Temporary folder.
    folder : Path
        Destination, which exists and is locked.
    displayed_path : Path
        Destination as the user wrote it, for messages.

    Raises
    ------
    ExportError
        Before any change, if a file that no export wrote would be replaced, or if the folder
        contains files of another format or plan.
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
            entry,
            present_files,
            strict=bool(file_format),
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
    """Compute the manifest of the files that a folder will contain.

    Results without a plan.json are added to the unchanged files of the same plan. Their manifest in
    the temporary folder is then rewritten with all files. Other files form a new generation.

    Parameters
    ----------
    source : Path
        Temporary folder with the new files.
    folder : Path
        Folder into which they will be moved.
    displayed_path : Path
        This folder as the user wrote it, for messages.
    manifest : dict
        Manifest of the new files.
    present_manifest : dict
        Manifest of the files in the folder, or an empty mapping.

    Returns
    -------
    dict
        Manifest of the new generation.

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
    entry: Path,
    present_files: Mapping[str, str],
    strict: bool,
) -> None:
    """Raise an error if a file of the user would be replaced.

    Exports and results may replace only files in the present manifest. A single file without a
    manifest may also replace a file that begins with the same `KIND_LENGTH` bytes.

    Parameters
    ----------
    target : Path
        File or folder that would be replaced. It need not exist.
    displayed_path : Path
        Its path for messages.
    entry : Path
        The new file or folder.
    present_files : mapping
        SHA-256 of the files that the present manifest lists, by name.
    strict : bool
        True if the new files have a manifest.

    Raises
    ------
    ExportError
        If such a file exists, or if a file would replace a folder or a folder a file.
    """
    if not os.path.lexists(target):
        return
    is_folder = entry.is_dir()
    resolve_destination(target, file_type_wanted=stat.S_IFDIR if is_folder else stat.S_IFREG)
    if not strict and not is_folder:
        kinds = {path.read_bytes()[:KIND_LENGTH] for path in (target, entry)}
        if len(kinds) == 1:
            return
    for path in (target, *target.rglob("*")):
        name = path.relative_to(target.parent).as_posix()
        if not path.is_dir() and name not in present_files:
            raise ExportError(
                f"{displayed_path}: exists, and {name} is not from this program; nothing is "
                "written. Choose another folder, or move this one."
            )


def _remove_stale(folder: Path, stale_files: Mapping[str, str]) -> None:
    """Remove the unchanged files of an earlier generation, and folders that become empty.

    Parameters
    ----------
    folder : Path
        Result folder or export folder.
    stale_files : mapping
        SHA-256 of the files by name. A file with another hash was changed by the user, and remains.
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
