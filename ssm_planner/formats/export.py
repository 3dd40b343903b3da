"""Export a plan to the formats of controllers.

`export` checks a plan again, calls the writer of the format (`format.FORMATS`) and adds a manifest
with hashes, certificate and, on request, a signature. It refuses a plan without a passed
certificate, unless the user forces an export that is marked as unverified. The export folder
appears only when every file is complete.
"""

from __future__ import annotations

import json
import math
import pkgutil
from dataclasses import replace
from pathlib import Path
from typing import Any

from ssm_planner.arguments import checked
from ssm_planner.errors import ExportError
from ssm_planner.formats.agreement import UNVERIFIED_SUFFIX, UNVERIFIED_WARNING
from ssm_planner.formats.csv import read_csv, read_layout
from ssm_planner.formats.format import FORMATS
from ssm_planner.formats.signature import SIGNATURE, sign_manifest
from ssm_planner.formats.stop_table import stop_table
from ssm_planner.plans import Plan, as_plan, software
from ssm_planner.problem import Robot, robot_hash
from ssm_planner.publishing import (
    EXPORT_FORMAT,
    MANIFEST,
    MANIFEST_VERSION,
    file_hashes,
    publishing,
)
from ssm_planner.stopping import MAX_INSTANTS, controlled_stops
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import JsonObject, Keywords
from ssm_planner.verification import Certificate, check_slower, with_seal
from ssm_planner.verification.check import check


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
    """Check a plan or a trajectory again, and write it in a format for controllers.

    Parameters
    ----------
    plan : Plan, Trajectory, str or Path
        Plan, trajectory, or the path of a plan.json.
    to : str
        Name of the format: "csv", "epos4", "pvt", "ros2", "urdf" or "c".
    path : str or Path, optional
        Folder to write. The default is a folder with the name of the format beside the plan.
    force : bool
        Export a plan that does not pass the check. Its file names and its manifest state that it is
        unverified.
    speed : float
        Fraction of the plan's speed, in (0, 1]. The slower motion receives its own certificate.
    stops : int, optional
        Number of instants, at least 1, for which stops.csv contains a controlled stop (csv and
        epos4 only).
    robot : Robot, optional
        Robot of a trajectory. A plan already contains its robot.
    sign : str or Path, optional
        PEM file with the private Ed25519 key that signs the manifest.
    **options
        Further options of the format, such as `rate` (Hz). `FORMATS[to].options` describes them.

    Returns
    -------
    files : dict of Path
        Paths by file name, including the manifest.
    manifest : dict
        Content of the manifest.

    Raises
    ------
    ExportError
        If the plan does not pass, or if an option is invalid for the format.
    ProblemError
        If the speed is out of range, or if an option does not have the type that the format needs.

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
    requested = options if stops is None else {**options, "stops": stops}
    for name, value in requested.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise ExportError(f"{name} = {value} is out of range (allowed: finite numbers)")
        if name not in form.options:
            formats = [label for label, entry in FORMATS.items() if name in entry.options]
            raise ExportError(
                f"{name} is not an option of the {to} export (allowed: "
                f"{', '.join(form.options) or 'no options'}; formats with {name}: "
                f"{', '.join(formats) or 'none'})"
            )
    if stops is not None and not 1 <= stops <= MAX_INSTANTS:
        raise ExportError(
            f"stops = {stops} is out of range (allowed: 1 or more, up to {MAX_INSTANTS})"
        )
    source = as_plan(plan, robot)
    certificate, is_verified = recheck_plan(source, force)
    if speed != 1.0:
        source = slowed_plan(source, speed, is_verified)
        certificate, is_verified = recheck_plan(source, force)
    suffix = "" if is_verified else UNVERIFIED_SUFFIX
    write = pkgutil.resolve_name(form.writer)
    folder = Path(path) if path is not None else source.path.parent / to
    with publishing(folder) as temporary:
        details = checked(write)(source, certificate, temporary, suffix, **options)
        if speed != 1.0:
            details["speed"] = speed
        if stops is not None:
            details |= _write_stops(source, temporary, f"stops{suffix}.csv", stops, details)
        manifest = write_manifest(
            temporary,
            to,
            plan=source,
            certificate=certificate,
            verified=is_verified,
            details=details,
            sign=None if sign is None else Path(sign),
        )
    files = {name: folder / name for name in manifest["files"]}
    return {**files, "manifest": folder / MANIFEST}, manifest


def slowed_plan(plan: Plan, speed: float, is_verified: bool) -> Plan:
    """Slow a plan down to a fraction of its speed.

    Parameters
    ----------
    plan : Plan
        Plan that is slowed down.
    speed : float
        Fraction of the speed, in (0, 1].
    is_verified : bool
        True if the plan has passed its check. The slower plan then receives a new certificate.
        Otherwise, its certificate is None.

    Returns
    -------
    Plan
        Plan with the slower motion. The rates of the task coordinates that the plan declares for
        both ends are slower as well. The file name and the hash are those of the original plan.

    Raises
    ------
    ProblemError
        If the speed is out of range.
    """
    limits = plan.limits.slower(1 / speed) if 0 < speed <= 1 else plan.limits
    certificate = check_slower(plan.motion, plan.robot, plan.limits, speed)
    motion = plan.motion.slower(speed)
    rates: Keywords = limits.declared_rates
    problem = replace(plan.problem, motion=limits.motion, **rates)
    seal = None
    if is_verified:
        seal = with_seal(certificate, motion, plan.robot, problem.task_limits)
    slowed = replace(plan, problem=problem, trajectory=motion, certificate=seal)
    # `replace` does not copy these two fields, and the class Plan is frozen.
    object.__setattr__(slowed, "file", plan.file)
    object.__setattr__(slowed, "file_sha256", plan.file_sha256)
    return slowed


def _write_stops(
    plan: Plan, folder: Path, name: str, count: int, details: JsonObject
) -> JsonObject:
    """Write a table of controlled stops that begin at instants of the exported motion.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    folder : Path
        Export folder. If it contains a table of positions and velocities whose motion keeps all
        limits, the stops start from this motion. Otherwise, they start from the motion of the plan.
    name : str
        Name of the file.
    count : int
        Number of instants.
    details : dict
        Entries of the manifest that the writer of the format has returned.

    Returns
    -------
    dict
        Entry of the manifest that describes the stops.

    Raises
    ------
    ExportError
        If a stop exceeds a limit.
    """
    stretch = details.get("stretch", 1.0)
    motion = plan.motion.slower(1 / stretch)
    limits = plan.limits.slower(stretch)
    table = folder / details.get("trajectory", "")
    if table.is_file() and "q1_rad" in read_layout(table).names:
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


def recheck_plan(plan: Plan, force: bool) -> tuple[Certificate, bool]:
    """Check a plan again before its export.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    force : bool
        Also accept a plan that does not pass.

    Returns
    -------
    certificate : Certificate
        The new certificate.
    passed : bool
        True if this certificate and the stored one passed. A plan without a stored certificate has
        not passed.

    Raises
    ------
    ExportError
        If the plan has not passed, unless `force` is true.
    """
    certificate = check(plan.motion, plan.robot, plan.limits)
    stored = plan.certificate
    if certificate.passed and stored is not None and stored.passed:
        return certificate, True
    if force:
        return certificate, False
    if not certificate.passed:
        raise ExportError(
            f"{plan.path}: the plan does not pass the check: it exceeds "
            f"{certificate.worst.excess}; not exported (use --force to export files that are "
            "marked unverified)"
        )
    reason = plan.uncertified_reason
    if not reason and stored is None:
        reason = "the plan has no certificate"
    raise ExportError(
        f"{plan.path}: {reason or 'the plan has a certificate that did not pass'}: plan again, or "
        "use --force to export files that are marked unverified"
    )


def write_manifest(
    folder: Path,
    format_name: str,
    plan: Plan,
    certificate: Certificate,
    verified: bool,
    details: JsonObject,
    sign: Path | None = None,
) -> JsonObject:
    """Write manifest.json next to the files that it lists, and return its content.

    Parameters
    ----------
    folder : Path
        Folder with the exported files.
    format_name : str
        Name of the format.
    plan : Plan
        The exported plan.
    certificate : Certificate
        The new certificate of the plan.
    verified : bool
        True if the plan has passed its check. If False, the manifest contains a warning.
    details : dict
        Entries that the writer of the format has returned.
    sign : Path, optional
        PEM file with a private Ed25519 key. Without it, the manifest is not signed.

    Returns
    -------
    dict
        Content of the manifest.
    """
    ends = plan.limits.slower(details.get("stretch", 1.0))
    manifest = {
        "format": EXPORT_FORMAT,
        "version": MANIFEST_VERSION,
        "kind": format_name,
        "verified": verified,
        **({} if verified else {"warning": UNVERIFIED_WARNING}),
        "plan": {"file": plan.path.name, "sha256": plan.sha256, "duration_s": plan.motion.duration},
        "robot": {"name": plan.robot.name, "sha256": robot_hash(plan.robot)},
        "software": software(),
        # Rates of task coordinates in rad/s and m/s. Missing ones are 0.
        **ends.declared_rates,
        **details,
        "certificate": certificate.to_dict(),
        "files": file_hashes(folder),
    }
    if sign is not None:
        manifest[SIGNATURE] = sign_manifest(manifest, sign)
    (folder / MANIFEST).write_text(
        json.dumps(manifest, indent=1, allow_nan=False) + "\n", encoding="utf-8"
    )
    return manifest
