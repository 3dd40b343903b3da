"""Export of a plan in the forms that controllers take: nothing without a passed certificate, nothing half written."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import ExportError
from ssm_planner.plans import Plan, load_plan, software
from ssm_planner.problem.serialization import robot_hash
from ssm_planner.publishing import EXPORT, MANIFEST, hashes, publishing
from ssm_planner.stopping import controlled_stops
from ssm_planner.verification.certificate import Certificate, sealed
from ssm_planner.verification.check import check
from ssm_planner.verification.slower import check_slower

FORMATS = ("csv", "epos4", "pvt", "ros2", "urdf", "c")
WITH_STOPS = ("csv", "epos4")
UNVERIFIED = "_unverified"
VERSION = 1
"""Of the manifest."""
WARNING = "UNVERIFIED: the plan has no passed certificate; do not run it on a machine"


def export(
    plan: Plan | str | Path,
    to: str,
    path: str | Path | None = None,
    *,
    force: bool = False,
    speed: float = 1.0,
    stops: int | None = None,
    **options: Any,
) -> tuple[dict[str, Path], dict[str, Any]]:
    """Write a plan in one of FORMATS into the folder `path` (default: `<to>` beside the plan); (files, manifest).

    The plan is checked once more, and one that does not pass is refused; with `force` it is written, and every file
    name and the manifest say that it is unverified. speed: share of its speed at which the motion is exported, with a
    certificate of its own. stops: also stops.csv, controlled stops from so many instants (csv and epos4). options: of the
    format, see its function. Raises ExportError or ProblemError.
    """
    if to not in FORMATS:
        raise ExportError(f"{to!r} is not a form of export (allowed: {', '.join(FORMATS)})")
    if stops is not None and (to not in WITH_STOPS or stops < 1):
        raise ExportError(
            f"stops = {stops!r} for {to} (allowed: 1 and more, for {', '.join(WITH_STOPS)})"
        )
    source = plan if isinstance(plan, Plan) else load_plan(plan)
    certificate, passed = verified(source, force)
    if speed != 1.0:
        source = slower(source, speed, passed)
        certificate, passed = verified(source, force)
    suffix = "" if passed else UNVERIFIED
    write = _writer(to, options)
    folder = Path(path) if path is not None else source.path.parent / to
    with publishing(folder) as temporary:
        details = write(source, certificate, temporary, suffix, **options)
        if speed != 1.0:
            details["speed"] = speed
        if stops is not None:
            details["stops"] = write_stops(
                source, temporary / f"stops{suffix}.csv", stops, details.get("axes", {})
            )
        manifest = write_manifest(
            temporary, to, plan=source, certificate=certificate, verified=passed, details=details
        )
    files = {name: folder / name for name in manifest["files"]}
    return {**files, "manifest": folder / MANIFEST}, manifest


def slower(plan: Plan, speed: float, passed: bool) -> Plan:
    """The plan played at a share of its speed, certified anew where it was before. Raises ProblemError."""
    limits = plan.limits.slower(1 / speed) if 0 < speed <= 1 else plan.limits
    certificate = check_slower(plan.motion, plan.robot, plan.limits, speed)
    motion = plan.motion.slower(speed)
    rates = limits.start_rate or {}, limits.end_rate or {}
    problem = replace(plan.problem, motion=limits.motion, start_rate=rates[0], end_rate=rates[1])
    made = replace(
        plan,
        problem=problem,
        trajectory=motion,
        certificate=sealed(certificate, motion, plan.robot, problem.task_limits)
        if passed
        else None,
    )
    object.__setattr__(made, "file", plan.file)
    object.__setattr__(made, "file_sha256", plan.file_sha256)
    return made


STOP_PERIOD = 1e-3
"""s between two rows of a stop."""


def write_stops(plan: Plan, path: Path, count: int, axes: Mapping[str, Any]) -> dict[str, Any]:
    """Controlled stops from `count` instants, one below the other, every millisecond and at rest; what the manifest says.

    axes: of a drive's export, with the increments per unit of position; where they are given, positions are increments.
    Raises ExportError where a stop breaks a limit.
    """
    found = controlled_stops(plan.motion, plan.robot, plan.limits, count)
    if not found.passed:
        worst = found.certificate.worst
        raise ExportError(
            f"{plan.path}: a stop exceeds {worst.name} of {worst.joint or 'the tool'}: stops not exported"
        )
    per_unit = [axes.get(joint.name, {}).get("increments_per_unit") for joint in plan.robot.joints]
    units = ["rad" if joint.kind == "revolute" else "m" for joint in plan.robot.joints]
    names = [
        f"{joint.name}_{unit if scale is None else 'inc'}"
        for joint, unit, scale in zip(plan.robot.joints, units, per_unit, strict=True)
    ]
    parts = []
    for begin, stop in zip(found.time, found.motions, strict=True):
        if stop is not None:
            t = np.append(np.arange(0.0, stop.duration, STOP_PERIOD), stop.duration)
            columns = [
                q if scale is None else np.round(scale * q)
                for q, scale in zip(stop.sample(t).q.T, per_unit, strict=True)
            ]
            parts.append(np.column_stack([np.full(len(t), begin), t, *columns]))
    rows = np.vstack(parts) if parts else np.empty((0, 2 + len(names)))
    forms = ["%.6f", "%.6f", *("%.12g" if scale is None else "%d" for scale in per_unit)]
    np.savetxt(
        path,
        rows,
        fmt=forms,
        delimiter=",",
        header=",".join(["from_s", "time_s", *names]),
        comments="",
    )
    return {
        "file": path.name,
        "instants": len(found.time),
        "longest_s": float(found.duration.max()),
        "farthest_m": float(found.travel.max()),
    }


def verified(plan: Plan, force: bool) -> tuple[Certificate, bool]:
    """(certificate found anew, whether it and the one in the file passed). Raises ExportError where not, unless forced."""
    found = check(plan.motion, plan.robot, plan.limits)
    stated = plan.certificate
    if found.passed and stated is not None and stated.passed:
        return found, True
    if force:
        return found, False
    if found.passed:
        what = (
            "the plan has no certificate"
            if stated is None
            else "the plan has a certificate that did not pass"
        )
        raise ExportError(
            f"{plan.path}: {plan.doubt or what}: plan again, or give --force for files marked unverified"
        )
    worst = found.worst
    raise ExportError(
        f"{plan.path}: the plan does not pass the check: {worst.name} of {worst.joint or 'the tool'} exceeds its limit "
        f"by {-100 * worst.margin:.3g} % at {worst.time:.4f} s; not exported (--force: marked unverified)"
    )


def write_manifest(
    folder: Path,
    kind: str,
    plan: Plan,
    certificate: Certificate,
    verified: bool,
    details: dict[str, Any],
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
    (folder / MANIFEST).write_text(
        json.dumps(manifest, indent=1, allow_nan=False) + "\n", encoding="utf-8"
    )
    return manifest


def _writer(to: str, options: dict[str, Any]) -> Callable[..., dict[str, Any]]:
    """The function that writes a format. Raises ExportError for options it does not take."""
    write: Callable[..., dict[str, Any]] = getattr(
        import_module(f"ssm_planner.formats.{to}"), f"export_{to}"
    )
    taken = list(inspect.signature(write).parameters)[4:]
    for name in options:
        if name not in taken:
            raise ExportError(
                f"{name} means nothing to an export to {to} (allowed: {', '.join(taken) or 'no options'})"
            )
    return write
