"""Export a plan to the formats of controllers.

An export requires a passed certificate, and its folder appears only when every file is complete.
"""

from __future__ import annotations

import json
import pkgutil
from dataclasses import replace
from pathlib import Path
from typing import Any

from ssm_planner.arguments import checked
from ssm_planner.errors import ExportError
from ssm_planner.formats.agreement import UNVERIFIED
from ssm_planner.formats.csv import layout_of, read_csv
from ssm_planner.formats.format import FORMATS
from ssm_planner.formats.signature import SIGNATURE, signature_of
from ssm_planner.formats.stop_table import stop_table
from ssm_planner.plans import Plan, as_plan, software
from ssm_planner.problem import Robot, robot_hash
from ssm_planner.publishing import EXPORT, MANIFEST, VERSION, hashes, publishing
from ssm_planner.stopping import controlled_stops
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import JsonObject, Keywords
from ssm_planner.verification import Certificate, check_slower, sealed
from ssm_planner.verification.check import check

WARNING = "UNVERIFIED: the plan has no passed certificate; do not run it on a machine"


@checked
def export(
    plan: Plan | Trajectory | str | Path,
    to: str,
    path: str | Path | None = None,
    *,
    force: bool = False,
    speed: float = 1.0,
    stops: int | None = None,
    robot: Robot | None = None,
    sign: str | Path | None = None,
    **options: Any,
) -> tuple[dict[str, Path], JsonObject]:
    """Export a plan or a trajectory in one of `FORMATS`.

    The plan is verified again first.

    Parameters
    ----------
    plan : Plan, Trajectory, str or Path
        Plan, trajectory, or the path of a plan.json.
    to : str
        Name of a format in `FORMATS`, such as csv or epos4.
    path : str or Path, optional
        Folder to write. The default is a folder with the name of the format beside the plan.
    force : bool
        Export a plan that does not pass. Its file names and its manifest state that it is
        unverified.
    speed : float
        Fraction of the plan's speed, in (0, 1]. The slower motion is certified separately.
    stops : int, optional
        Number of instants, at least 1, for which stops.csv holds a controlled stop (csv and epos4
        only).
    robot : Robot, optional
        Robot of a trajectory. A plan names its robot.
    sign : str or Path, optional
        PEM file with the private Ed25519 key that signs the manifest.
    **options
        Options of the format, see `Format.options`.

    Returns
    -------
    files : dict[str, Path]
        Paths by file name, including the manifest.
    manifest : dict

    Raises
    ------
    ExportError
        If the plan does not pass, or an option is invalid for the format.
    ProblemError
        If the speed is out of range.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> from tempfile import mkdtemp
    >>> files, manifest = ssm.export("results/tilt_insert", "csv", mkdtemp() + "/csv")
    >>> sorted(files), manifest["verified"]
    (['manifest', 'trajectory.csv'], True)
    """
    if to not in FORMATS:
        raise ExportError(f"unknown export format {to!r} (allowed: {', '.join(FORMATS)})")
    form = FORMATS[to]
    if stops is not None and ("stops" not in form.options or stops < 1):
        raise ExportError(
            f"stops = {stops!r} is not allowed for {to} (allowed: 1 or more, for "
            f"{', '.join(name for name, other in FORMATS.items() if 'stops' in other.options)})"
        )
    for name in options:
        if name not in form.options:
            raise ExportError(
                f"{name} is not an option of the {to} export (allowed: "
                f"{', '.join(form.options) or 'no options'})"
            )
    source = as_plan(plan, robot)
    certificate, passed = verified(source, force)
    if speed != 1.0:
        source = slower(source, speed, passed)
        certificate, passed = verified(source, force)
    suffix = "" if passed else UNVERIFIED
    write = pkgutil.resolve_name(form.writer)
    folder = Path(path) if path is not None else source.path.parent / to
    with publishing(folder) as temporary:
        details = write(source, certificate, temporary, suffix, **options)
        if speed != 1.0:
            details["speed"] = speed
        if stops is not None:
            details |= _stops(source, temporary, f"stops{suffix}.csv", stops, details)
        manifest = write_manifest(
            temporary,
            to,
            plan=source,
            certificate=certificate,
            verified=passed,
            details=details,
            sign=None if sign is None else Path(sign),
        )
    files = {name: folder / name for name in manifest["files"]}
    return {**files, "manifest": folder / MANIFEST}, manifest


def slower(plan: Plan, speed: float, passed: bool) -> Plan:
    """Return the plan played at a fraction of its speed.

    passed: the plan passed its check, so the slower plan receives a new certificate. Raises
    ProblemError if the speed is not in (0, 1].
    """
    limits = plan.limits.slower(1 / speed) if 0 < speed <= 1 else plan.limits
    certificate = check_slower(plan.motion, plan.robot, plan.limits, speed)
    motion = plan.motion.slower(speed)
    rates: Keywords = limits.declared_rates
    problem = replace(plan.problem, motion=limits.motion, **rates)
    slowed = replace(
        plan,
        problem=problem,
        trajectory=motion,
        certificate=sealed(certificate, motion, plan.robot, problem.task_limits)
        if passed
        else None,
    )
    object.__setattr__(slowed, "file", plan.file)
    object.__setattr__(slowed, "file_sha256", plan.file_sha256)
    return slowed


def _stops(plan: Plan, folder: Path, name: str, count: int, details: JsonObject) -> JsonObject:
    """Write controlled stops from `count` instants of the exported motion.

    `details` has the entries of the manifest. Returns further ones. Raises ExportError if a stop
    exceeds a limit.
    """
    stretch = details.get("stretch", 1.0)
    motion, limits = plan.motion.slower(1 / stretch), plan.limits.slower(stretch)
    table = folder / details.get("trajectory", "")
    if table.is_file() and "q1_rad" in layout_of(table).names:
        reading = read_csv(table, plan.robot)
        if reading.resolution is None and not reading.check(plan.robot, limits).violations:
            motion = reading.trajectory
    stops = controlled_stops(motion, plan.robot, limits, count)
    if not stops.passed:
        violation = stops.certificate.worst
        raise ExportError(
            f"{plan.path}: a stop exceeds {violation.name} of {violation.joint or 'the tool'}: "
            "stops not exported"
        )
    return stop_table(stops, plan.robot, details.get("axes", {}), name).write(folder)


def verified(plan: Plan, force: bool) -> tuple[Certificate, bool]:
    """Check a plan again before its export.

    Returns the new certificate, and whether both it and the stored certificate passed. A plan
    without a stored certificate has not passed.

    Raises ExportError if one of the two did not pass, unless `force` is True.
    """
    certificate = check(plan.motion, plan.robot, plan.limits)
    stored = plan.certificate
    if certificate.passed and stored is not None and stored.passed:
        return certificate, True
    if force:
        return certificate, False
    if certificate.passed:
        reason = (
            "the plan has no certificate"
            if stored is None
            else "the plan has a certificate that did not pass"
        )
        raise ExportError(
            f"{plan.path}: {plan.uncertified_reason or reason}: plan again, or use --force to "
            "export files that are marked unverified"
        )
    violation = certificate.worst
    raise ExportError(
        f"{plan.path}: the plan does not pass the check: {violation.name} of "
        f"{violation.joint or 'the tool'} exceeds its limit "
        f"by {-100 * violation.margin:.3g} % at {violation.time:.4f} s; not exported (use --force "
        "to export files that are marked unverified)"
    )


def write_manifest(
    folder: Path,
    kind: str,
    plan: Plan,
    certificate: Certificate,
    verified: bool,
    details: JsonObject,
    sign: Path | None = None,
) -> JsonObject:
    """Write manifest.json beside the files that it lists and return its content.

    kind: format of the export. details: entries that this format adds. sign: file of a private key.
    """
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
        # Rates of task coordinates in rad/s and m/s. Missing ones are 0.
        **ends.declared_rates,
        **details,
        "certificate": certificate.to_dict(),
        "files": hashes(folder),
    }
    if sign is not None:
        manifest[SIGNATURE] = signature_of(manifest, sign)
    (folder / MANIFEST).write_text(
        json.dumps(manifest, indent=1, allow_nan=False) + "\n", encoding="utf-8"
    )
    return manifest
