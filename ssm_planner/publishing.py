"""Publish the files of a result folder such that they always belong to one plan.

A generation consists of all files that belong to one plan. They are first written to a temporary
folder. Then a manifest.json with the hash of every file and a mark of incompleteness is written to
the result folder. The files follow, and finally the manifest without the mark. If the program is
interrupted, the folder either contains one generation, or its mark shows that it does not.
"""

import hashlib
import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath

from ssm_planner.atomic import (
    destination,
    held_signals,
    locked,
    replacing,
    staging,
    sync,
    written_files,
)
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.typing import JsonObject

MANIFEST = "manifest.json"
PLAN = "plan.json"
EXPORT = "ssm_planner export"
"""Value of the key `format` in the manifest of an export folder."""
RESULTS = "ssm_planner results"
"""Value of the key `format` in the manifest of a result folder."""
VERSION = 1
"""Version of the format of a manifest."""
INCOMPLETE = "incomplete"
"""Key of a manifest whose folder is being changed."""
LARGEST_MANIFEST = 64 * 2**20
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
    change, if the folder cannot be written, contains something else, or has a file or folder of the
    same name that no export wrote.
    """
    with staging(folder) as temporary:
        yield temporary
        _publish(temporary, destination(folder, file_type_wanted=stat.S_IFDIR), folder)


@contextmanager
def publishing_results(folder: Path, plan: str | None = None) -> Iterator[Path]:
    """Yield a temporary folder like `publishing`, for files made from one plan.

    If a plan.json is among the files, they form a new generation. Otherwise they are added to the
    files of the plan whose SHA-256 is `plan`. Raises ExportError if the folder contains another
    plan.
    """
    with publishing(folder) as temporary:
        yield temporary
        files = hashes(temporary)
        sha = files.get(PLAN, plan)
        manifest = {"format": RESULTS, "version": VERSION, "plan": sha, "files": files}
        _write_manifest(temporary / MANIFEST, manifest)


@contextmanager
def replacing_result(path: Path, plan: str) -> Iterator[Path]:
    """Yield a path like `replacing` for a file made from one plan.

    The SHA-256 of the plan is `plan`. In the result folder of this plan, the manifest is updated.
    """
    if read_manifest(path.parent).get("format") != RESULTS:
        with replacing(path) as temporary:
            yield temporary
        return
    with publishing_results(path.parent, plan) as folder:
        yield folder / path.name


def hashes(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file below a folder except the manifest, by relative path."""
    files = (
        path for path in sorted(folder.rglob("*")) if path.is_file() and path != folder / MANIFEST
    )
    return {path.relative_to(folder).as_posix(): sha256(path) for path in files}


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
        if not path.is_file() or path.stat().st_size > LARGEST_MANIFEST:
            return {}
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if isinstance(document, dict) and document.get("format") in (EXPORT, RESULTS):
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
    if manifest.get(INCOMPLETE):
        raise TrajectoryError(
            f"{folder}: publishing was interrupted, so the files may be of two plans: make them "
            "again"
        )
    for name, sha in listed_files(manifest).items():
        if os.path.exists(folder / name) and not _is(folder / name, sha):
            raise TrajectoryError(
                f"{folder / name}: is not the file that {MANIFEST} lists; re-create the results, "
                f"or remove {MANIFEST} if you changed the file yourself"
            )


def _publish(source: Path, folder: Path, displayed_path: Path) -> None:
    """Rename a temporary folder to its final name, or move its files into an existing folder.

    `displayed_path` is the path of the folder as the user wrote it, for messages.
    """
    sync(source)
    with held_signals():
        if not folder.exists():
            with suppress(OSError):  # another process was faster
                source.rename(folder)
                sync(folder.parent, content=False)
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
    old = read_manifest(folder)
    ours = listed_files(old)
    file_format = manifest.get("format")
    if file_format:
        manifest = _merged(source, folder, displayed_path, manifest, old=old)
    entries = sorted(path for path in source.iterdir() if path.name != MANIFEST)
    for entry in entries:
        _check_way(
            folder / entry.name,
            displayed_path / entry.name,
            entry.is_dir(),
            ours,
            strict=file_format == EXPORT,
        )
    replaced = source / ".replaced"
    replaced.mkdir()
    if file_format:
        marked = {**manifest, INCOMPLETE: True, "files": {**ours, **listed_files(manifest)}}
        marker = source / ".begun"
        _write_manifest(marker, marked)
        marker.replace(folder / MANIFEST)
        sync(folder, content=False)
    for entry in entries:
        if entry.is_dir() and (folder / entry.name).exists():
            (folder / entry.name).rename(replaced / entry.name)
        entry.replace(folder / entry.name)
    if file_format:
        names = listed_files(manifest)
        _remove_stale(folder, {name: sha for name, sha in ours.items() if name not in names})
        sync(folder, content=False)
        (source / MANIFEST).replace(folder / MANIFEST)
    sync(folder, content=False)


def _merged(
    source: Path,
    folder: Path,
    displayed_path: Path,
    manifest: JsonObject,
    *,
    old: JsonObject,
) -> JsonObject:
    """Return the manifest of the new generation.

    Files without a plan.json are added to the unchanged files of the same plan.

    Parameters
    ----------
    source, folder : Path
        Temporary folder with the new files, and folder into which they will be moved.
    displayed_path : Path
        Path of the folder for messages.
    manifest, old : dict
        Manifests of the new files, and of the files in the folder.

    Raises
    ------
    ExportError
        If the folder contains files of another format or another plan.
    """
    if not old:
        return manifest
    hint = "choose another folder (nothing was written)"
    if old["format"] != manifest["format"]:
        description = "an export" if old["format"] == EXPORT else "the results of a plan"
        raise ExportError(f"{displayed_path}: holds {description}: {hint}")
    if manifest["format"] != RESULTS or PLAN in listed_files(manifest):
        return manifest
    if old.get("plan") != manifest["plan"]:
        raise ExportError(f"{displayed_path}: holds results of another plan: {hint}")
    ours = listed_files(old).items()
    unchanged = {name: sha for name, sha in ours if _is(folder / name, sha)}
    manifest["files"] = dict(sorted({**unchanged, **manifest["files"]}.items()))
    _write_manifest(source / MANIFEST, manifest)
    return manifest


def _write_manifest(path: Path, manifest: JsonObject) -> None:
    """Write a manifest and flush it to the disk."""
    path.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    sync(path)


def _check_way(
    target: Path, displayed_path: Path, is_folder: bool, ours: Mapping[str, str], strict: bool
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
    ours : Mapping
        Files that the present manifest lists.
    strict : bool
        True if the new files are an export. Results may replace any single file.
    """
    if not os.path.lexists(target):
        return
    destination(target, file_type_wanted=stat.S_IFDIR if is_folder else stat.S_IFREG)
    files = [path for path in target.rglob("*") if not path.is_dir()] if is_folder else [target]
    for path in files:
        name = path.relative_to(target.parent).as_posix()
        if (strict or is_folder) and name not in ours:
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
            if _is(folder / name, sha):
                (folder / name).unlink()
                for parent in PurePosixPath(name).parents:
                    if parent != PurePosixPath("."):
                        (folder / parent).rmdir()


def _is(path: Path, sha: str) -> bool:
    """Return True if a file exists and has this SHA-256."""
    return os.path.isfile(path) and sha256(path) == sha


def is_inside(name: str) -> bool:
    """Return True if a relative name stays inside its folder on every operating system."""
    path = PurePosixPath(name)
    return (
        bool(name)
        and "\0" not in name
        and "\\" not in name
        and not path.is_absolute()
        and ".." not in path.parts
    )
