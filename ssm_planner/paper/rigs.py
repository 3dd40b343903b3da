"""The three rigs: friction identified from the shipped figures, and torque predicted for the recordings that exist."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from ssm_planner.errors import RecordingError
from ssm_planner.identification.fit import MapFit, fit_map
from ssm_planner.identification.parameters import map_torque, with_parameters
from ssm_planner.identification.prediction import nrmsd, predict
from ssm_planner.identification.recording import read_recordings
from ssm_planner.identification.rig_figures import TABLE
from ssm_planner.identification.torque_map import TorqueMap, read_figures
from ssm_planner.model.friction import friction_of
from ssm_planner.paper.inputs import Inputs
from ssm_planner.paper.published import RIGS
from ssm_planner.problem.rig import Rig
from ssm_planner.problem.values import Drive, FrictionLawName

LAWS = ("coulomb", "stribeck_exponential")
"""The two that the package fits."""


@dataclass(frozen=True, eq=False)
class Tested:
    """One recording of a moving rig: NRMSD with the authors' parameters and with ours."""

    recording: str
    published: float
    ours: float
    repairs: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class RigResult:
    """name: stem of the drive file. published: the drive with the authors' parameters and their Stribeck form."""

    name: str
    rig: Rig
    data: TorqueMap
    published: Drive
    fits: Mapping[str, MapFit]
    """By law."""
    chosen: str
    """The law of lowest AICc."""
    tested: tuple[Tested, ...] = ()
    left_out: str = ""
    """Why no recording of a moving rig is predicted; empty where one is."""

    @property
    def title(self) -> str:
        """The drive's name, such as `rig 3, worm gear`."""
        return self.published.name

    def map_nrmsd(self, drive: Drive) -> float:
        return nrmsd(map_torque(drive, self.data.w, self.rig.F_payload), self.data.tau)


def published_drive(drive: Drive, law: FrictionLawName = "stribeck_exponential") -> Drive:
    """A rig's drive with the authors' parameters; Coulomb friction where they give no Stribeck speed."""
    values = dict(_rig(drive).published)
    chosen = law if values.get("stribeck_speed") else "coulomb"
    made = with_parameters(drive, chosen, values)
    friction = replace(
        friction_of(made),
        mu_static=values["mu"] + values.get("mu_stribeck", 0.0),
        dwell_constant=values.get("dwell_constant"),
        memory=values.get("memory", 0.0),
    )
    return replace(made, friction=friction)


def rig_result(inputs: Inputs, name: str) -> RigResult:
    """Identification of one rig from the table of figures, and its start–stop recordings predicted where they exist.

    Raises RecordingError where the table cannot be read.
    """
    drive = inputs.rigs[name]
    rig = _rig(drive)
    data = read_figures(inputs.folder / "drives" / TABLE, name)
    fits = {law: fit_map(drive, data, rig.F_payload, law=law, reference=rig.published) for law in LAWS}
    criterion = {law: fit.criterion[law] for law, fit in fits.items()}
    chosen = min(criterion, key=lambda law: criterion[law])
    result = RigResult(name, rig, data, published_drive(drive), fits, chosen)
    folder = inputs.recordings / RIGS[name] / "start_stop"
    if not folder.is_dir():
        return replace(result, left_out="the recordings are not here: name their folder by --recordings")
    try:
        return replace(result, tested=_tested(result, folder))
    except RecordingError as error:
        return replace(result, left_out=_plain(error, folder))


def _tested(result: RigResult, folder: Path) -> tuple[Tested, ...]:
    rig, ours = result.rig, result.fits[result.chosen].drive
    found = read_recordings([folder], nominal_torque=rig.motor_nominal_torque, direction=rig.direction)
    load, inertia = rig.F_payload, rig.payload_inertia
    return tuple(
        Tested(
            recording.name,
            predict(result.published, recording, load, inertia).nrmsd,
            predict(ours, recording, load, inertia).nrmsd,
            recording.repairs,
        )
        for recording in found
    )


def _plain(error: RecordingError, folder: Path) -> str:
    """The message without the reader's own folders, so that the document is the same for everyone."""
    return str(error).replace(f"{folder}/", "").replace(str(folder), folder.name).replace("|", "/")


def _rig(drive: Drive) -> Rig:
    assert drive.rig is not None, drive.name
    return drive.rig
