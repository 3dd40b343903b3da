"""The rigs in the document: parameters beside the authors', maps, and predicted against measured torque."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.identification.fit import MapFit
from ssm_planner.identification.parameters import map_torque
from ssm_planner.paper.rigs import LAWS, RigResult
from ssm_planner.paper.section import NOTHING, Section, minus, number, percent, picture, table, text
from ssm_planner.report.style import COLOURS, FIFTH, RPM, SIZE, finish, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    lines = text(
        "The torque–velocity maps of the paper's joints come from recordings that are not public. Those of the package's "
        "three rigs are; their mean speeds and torques ship as `problems/drives/rig_figures.csv` and are identified here by "
        "the package's two laws: constant μ (Coulomb), and μ_c + μ_str·exp(−2|w|/w_s) (Stribeck, as its code computes it). "
        "In brackets 95 % intervals; inside and outside say where the published value lies."
    )
    for result in results:
        lines += [f"### {result.title[0].upper()}{result.title[1:]}", "", *_parameters(result)]
    lines += picture("rig_maps", "Maps of the rigs: figures of the recordings, published parameters, our fits")
    lines += ["### Predicted against measured torque", "", *_predictions(results)]
    also = [f"ssm-planner identify problems/drives/{result.name}.yaml" for result in results]
    return Section("The rigs: identification and prediction", lines, {"rig_maps": _figure(results)}, also)


def _parameters(result: RigResult) -> list[str]:
    fits = [result.fits[law] for law in LAWS]
    rows = []
    for name, (symbol, scale) in SHOWN.items():
        value = result.rig.published.get(name)
        cells = [symbol, NOTHING if value is None else number(scale * value)]
        rows.append([*cells, *(cell for fit in fits for cell in _estimate(fit, name, scale, value))])
    head = ("parameter", "published", "ours, Coulomb", "difference", "ours, Stribeck", "difference")
    nrmsds = [f"{result.map_nrmsd(drive):.4f}" for drive in (result.published, *(fit.drive for fit in fits))]
    criteria = [f"{minus(f'{fit.criterion[law]:.1f}')} {NAMES[law]}" for law, fit in zip(LAWS, fits, strict=True)]
    words = (
        f"NRMSD of the map: {nrmsds[0]} with the published parameters, {nrmsds[1]} Coulomb, {nrmsds[2]} Stribeck. AICc "
        f"prefers {NAMES[result.chosen]} ({', '.join(criteria)})."
    )
    why = [reason for law, fit in zip(LAWS, fits, strict=True) for reason in _reasons(fit, NAMES[law])]
    if why:
        words += f" Why they differ: {'; '.join(why)}."
    return [*table(head, rows), *text(words)]


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
    """What of the fit explains that parameters differ."""
    reasons = []
    if fit.inseparable:
        groups = " and ".join(", ".join(SYMBOLS[name] for name in group) for group in fit.inseparable)
        reasons.append(f"with {law} the map gives {groups} only in combination, so that values far apart fit alike")
    if fit.estimates["mu"].at_bound:
        reasons.append(f"with {law} μ_c sits at the least with which the drive still locks itself")
    return reasons


def _predictions(results: tuple[RigResult, ...]) -> list[str]:
    rows = []
    for result in results:
        if result.left_out:
            rows.append((result.title, NOTHING, NOTHING, NOTHING, f"left out: {result.left_out}"))
        rows += [
            (
                result.title,
                tested.recording,
                f"{tested.published:.3f}",
                f"{tested.ours:.3f}",
                "; ".join(tested.repairs) or "none",
            )
            for tested in result.tested
        ]
    head = ("rig", "start–stop recording", "NRMSD, published parameters", "NRMSD, ours", "repairs to the recording")
    return [
        *table(head, rows, words=(1, 4)),
        *text(
            "Measured speed in, motor torque out, as for Table III. Ours is the fit that AICc prefers, from the map alone: "
            "no start–stop recording went into it. The paper prints 0.08 to 0.13 for its prototype (Table III)."
        ),
    ]


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
