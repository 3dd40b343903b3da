"""Export of a plan in the forms that controllers take: nothing without a passed certificate, nothing half written."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from ssm_planner.errors import ExportError
from ssm_planner.plans import Plan, load_plan, software
from ssm_planner.problem.serialization import robot_hash
from ssm_planner.publishing import EXPORT, MANIFEST, hashes, publishing
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.check import check

FORMATS = ("csv", "epos4", "pvt", "ros2", "urdf", "c")
UNVERIFIED = "_unverified"
VERSION = 1
"""Of the manifest."""
WARNING = "UNVERIFIED: the plan has no passed certificate; do not run it on a machine"


def export(
    plan: Plan | str | Path, to: str, path: str | Path | None = None, *, force: bool = False, **options: Any
) -> tuple[dict[str, Path], dict[str, Any]]:
    """Write a plan in one of FORMATS into the folder `path` (default: `<to>` beside the plan); (files, manifest).

    The plan is checked once more, and one that does not pass is refused; with `force` it is written, and every file
    name and the manifest say that it is unverified. options: of the format, see its function. Raises ExportError.
    """
    if to not in FORMATS:
        raise ExportError(f"{to!r} is not a form of export (allowed: {', '.join(FORMATS)})")
    source = plan if isinstance(plan, Plan) else load_plan(plan)
    certificate, passed = verified(source, force)
    suffix = "" if passed else UNVERIFIED
    write = _writer(to, options)
    folder = Path(path) if path is not None else source.path.parent / to
    with publishing(folder) as temporary:
        details = write(source, certificate, temporary, suffix, **options)
        manifest = write_manifest(temporary, to, plan=source, certificate=certificate, verified=passed, details=details)
    files = {name: folder / name for name in manifest["files"]}
    return {**files, "manifest": folder / MANIFEST}, manifest


def verified(plan: Plan, force: bool) -> tuple[Certificate, bool]:
    """(certificate found anew, whether it and the one in the file passed). Raises ExportError where not, unless forced."""
    found = check(plan.motion, plan.robot, plan.limits)
    stated = plan.certificate
    if found.passed and stated is not None and stated.passed:
        return found, True
    if force:
        return found, False
    if found.passed:
        what = "the plan has no certificate" if stated is None else "the plan has a certificate that did not pass"
        raise ExportError(f"{plan.path}: {plan.doubt or what}: plan again, or give --force for files marked unverified")
    worst = found.worst
    raise ExportError(
        f"{plan.path}: the plan does not pass the check: {worst.name} of {worst.joint or 'the tool'} exceeds its limit "
        f"by {-100 * worst.margin:.3g} % at {worst.time:.4f} s; not exported (--force: marked unverified)"
    )


def write_manifest(
    folder: Path, kind: str, plan: Plan, certificate: Certificate, verified: bool, details: dict[str, Any]
) -> dict[str, Any]:
    """Write manifest.json beside the files it lists; details: what the kind of export has to say."""
    ends = plan.limits.slower(details.get("stretch", 1.0))
    manifest = {
        "format": EXPORT,
        "version": VERSION,
        "kind": kind,
        "verified": verified,
        **({} if verified else {"warning": WARNING}),
        "plan": {"file": plan.path.name, "sha256": plan.sha256, "duration_s": plan.motion.duration},
        "robot": {"name": plan.robot.name, "sha256": robot_hash(plan.robot)},
        "software": software(),
        # of task coordinates, rad/s and m/s; 0 where not named
        "start_rate": dict(ends.start_rate or {}),
        "end_rate": dict(ends.end_rate or {}),
        **details,
        "certificate": certificate.to_dict(),
        "files": hashes(folder),
    }
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return manifest


def _writer(to: str, options: dict[str, Any]) -> Callable[..., dict[str, Any]]:
    """The function that writes a format. Raises ExportError for options it does not take."""
    write: Callable[..., dict[str, Any]] = getattr(import_module(f"ssm_planner.formats.{to}"), f"export_{to}")
    taken = list(inspect.signature(write).parameters)[4:]
    for name in options:
        if name not in taken:
            raise ExportError(
                f"{name} means nothing to an export to {to} (allowed: {', '.join(taken) or 'no options'})"
            )
    return write
