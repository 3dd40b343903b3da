"""The three rigs: friction identified from the shipped figures beside the authors', predicted against measured torque."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.errors import RecordingError
from ssm_planner.identification.fit import MapFit, fit_map
from ssm_planner.identification.parameters import map_torque, with_parameters
from ssm_planner.identification.prediction import nrmsd, predict_recording
from ssm_planner.identification.recordings import read_recordings
from ssm_planner.identification.torque_map import TABLE, TorqueMap, read_figures
from ssm_planner.paper.published import RIGS, Inputs
from ssm_planner.paper.section import NOTHING, Section, number, percent
from ssm_planner.problem.drive import Drive, FrictionLawName, Rig
from ssm_planner.reporting.figures.style import COLOURS, FIFTH, SIZE, finish, new_figure
from ssm_planner.units import RPM

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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

    def parameters(self) -> Iterator[list[str]]:
        """Rows: a parameter, its published value, and for every law its estimate and the difference."""
        for name, (symbol, scale) in SHOWN.items():
            value = self.rig.published.get(name)
            estimates = (cell for fit in self.fits.values() for cell in _estimate(fit, name, scale, value))
            yield [symbol, NOTHING if value is None else number(scale * value), *estimates]

    def reasons(self) -> list[str]:
        """What of the fits explains that parameters differ."""
        return [reason for law, fit in self.fits.items() for reason in _reasons(fit, NAMES[law])]


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
    result = RigResult(name, rig, data, published=published_drive(drive), fits=fits, chosen=chosen)
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
            predict_recording(result.published, recording, load, inertia).nrmsd,
            predict_recording(ours, recording, load, inertia).nrmsd,
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


SYMBOLS = {"b_c": "b_c", "b_v": "b_v", "b_oc": "b_oc", "mu": "μ_c", "mu_stribeck": "μ_str", "stribeck_speed": "w_s"}
SHOWN = {
    "b_c": ("10³ b_c (N·m)", 1e3),
    "b_v": ("10⁵ b_v (N·m·s/rad)", 1e5),
    "b_oc": ("10³ b_oc (N·m; N)", 1e3),
    "mu": ("μ_c", 1.0),
    "mu_stribeck": ("μ_str", 1.0),
    "stribeck_speed": ("w_s (rad/s)", 1.0),
}
NAMES = dict(zip(LAWS, ("Coulomb", "Stribeck"), strict=True))


def rigs_section(results: tuple[RigResult, ...]) -> Section:
    """Parameters, maps and predictions of the three rigs."""
    return Section("rigs", {"rigs": results, "NAMES": NAMES}, {"rig_maps": _figure(results)})


def _estimate(fit: MapFit, name: str, scale: float, published: float | None) -> tuple[str, str]:
    estimate = fit.estimates.get(name)
    if estimate is None:
        return NOTHING, NOTHING
    low, high = (number(scale * end) for end in (estimate.low, estimate.high))
    shown = f"{number(scale * estimate.value)} ({low} … {high})"
    if published is None:
        return shown, NOTHING
    where = "inside" if estimate.low <= published <= estimate.high else "outside"
    return shown, f"{percent(estimate.value / published - 1.0, 0)}, {where}"


def _reasons(fit: MapFit, law: str) -> list[str]:
    reasons = []
    if fit.inseparable:
        groups = " and ".join(", ".join(SYMBOLS[name] for name in group) for group in fit.inseparable)
        reasons.append(f"with {law} the map gives {groups} only in combination, so that values far apart fit alike")
    if fit.estimates["mu"].at_bound:
        reasons.append(f"with {law} μ_c sits at the least with which the drive still locks itself")
    return reasons


def _figure(results: tuple[RigResult, ...]) -> Figure:
    figure = new_figure(9.6, 3.6)
    for axes, result in zip(figure.subplots(1, len(results)), results, strict=True):
        data, load = result.data, result.rig.F_payload
        axes.plot(RPM * data.w, 1e3 * data.tau, "o", color="black", fillstyle="none", markersize=4, label="recordings")
        drives = (
            ("published", result.published, ":", FIFTH),
            ("ours, Coulomb", result.fits[LAWS[0]].drive, "--", COLOURS[1]),
            ("ours, Stribeck", result.fits[LAWS[1]].drive, "-", COLOURS[0]),
        )
        for label, drive, dash, colour in drives:
            for sign in (1.0, -1.0):
                side = np.abs(data.w[np.sign(data.w) == sign])
                w = sign * np.geomspace(side.min(), side.max(), 200)
                torque = 1e3 * map_torque(drive, w, load)
                axes.plot(RPM * w, torque, dash, color=colour, linewidth=1.4, label=label if sign > 0 else None)
        axes.axhline(0.0, color="0.7", linewidth=0.6, zorder=0)
        axes.set_title(result.title, fontsize=SIZE)
        finish(axes, "motor speed (rpm)", "motor torque (mN·m)" if result is results[0] else "")
        axes.legend(fontsize=SIZE - 2, frameon=False, loc="lower right")
    return figure
