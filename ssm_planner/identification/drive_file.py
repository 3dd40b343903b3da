"""Write the file of a drive with its identified friction, intervals and sources, as YAML.

`write_drive` copies a drive file and replaces its friction. `Identification.save` calls it.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ssm_planner.atomic import write_text
from ssm_planner.dynamics import required_friction
from ssm_planner.identification.fit import Estimate, MapFit
from ssm_planner.loading.drives import POSTERIOR_PART_TYPES
from ssm_planner.problem import (
    LOAD_OFFSET,
    Drive,
    Friction,
    Posterior,
    Rig,
    field_quantities,
    unit_kind,
)
from ssm_planner.publishing import one_line
from ssm_planner.typing import JsonObject
from ssm_planner.units import QUANTITY_KINDS


def write_drive(
    path: str | Path,
    template: str | Path,
    drive: Drive,
    fit: MapFit,
    dynamic: Mapping[str, Estimate],
    evidence: str,
) -> None:
    """Write a drive file with identified friction.

    Each parameter states its 95 % interval. The file is replaced as a whole, so it is never
    incomplete.

    Parameters
    ----------
    path : str or Path
        File that is written.
    template : str or Path
        Drive file whose friction was identified. Its other keys are copied.
    drive : Drive
        Drive with the identified friction.
    fit : MapFit
        Fit of the torque–velocity map.
    dynamic : Mapping
        Estimates from the start–stop recordings, by name of the parameter.
    evidence : str
        Description of the recordings, which becomes the source of the friction.

    Raises
    ------
    ExportError
        If the file cannot be written.
    """
    import yaml  # It takes long to import.

    content: JsonObject = yaml.safe_load(Path(template).read_text(encoding="utf-8"))
    content["friction"] = _friction_entry(drive, fit, dynamic, evidence)
    if "preload" in fit.estimates and not fit.estimates["preload"].fixed:
        content["preload"] = _parameter_entry(
            drive, "preload", drive.preload, fit.estimates["preload"]
        )
    if LOAD_OFFSET in fit.estimates and drive.rig is not None:
        content["rig"]["load_offset"] = _quantity_text(drive, "load_offset", drive.rig.load_offset)
    elif drive.rig is not None:
        content["rig"].pop("load_offset", None)
    text = _heading_comments(fit, evidence) + yaml.safe_dump(
        content, sort_keys=False, allow_unicode=True, width=110
    )
    write_text(Path(path), text, mark=" from ")


def _heading_comments(fit: MapFit, evidence: str) -> str:
    """Return the comment lines at the beginning of the file, which summarise the fit.

    Parameters
    ----------
    fit : MapFit
        Fit of the torque–velocity map.
    evidence : str
        Description of the recordings.

    Returns
    -------
    str
        Lines that begin with `# `: the source, the law and its error, the probabilities of the
        laws, the parameters that depend on the prior, and the outliers.
    """
    lines = [
        f"Friction identified from {evidence}.",
        f"Law {fit.law}, NRMSD of the torque-velocity map {fit.nrmsd:.4f} over "
        f"{len(fit.predicted)} points.",
        "Intervals are of 95 % confidence.",
    ]
    if len(fit.law_shares) > 1:
        shares = ", ".join(f"{law} {share:.1%}" for law, share in fit.law_shares.items())
        lines.append(f"How likely each law is, as a share of the sets of the posterior: {shares}.")
    for group in fit.inseparable:
        lines.append(
            f"The data determine {', '.join(group)} only together: their intervals depend on prior "
            "knowledge."
        )
    lines += [f"Outlier, weight {weight:.2g}: {name}." for name, _, weight in fit.outliers]
    return "".join(f"# {one_line(line)}\n" for line in lines)


def _friction_entry(
    drive: Drive, fit: MapFit, dynamic: Mapping[str, Estimate], evidence: str
) -> JsonObject:
    """Build the content of the key "friction" of the drive file.

    Parameters
    ----------
    drive : Drive
        Drive with the identified friction.
    fit : MapFit
        Fit of the torque–velocity map.
    dynamic : Mapping
        Estimates from the start–stop recordings, by name of the parameter.
    evidence : str
        Description of the recordings, which becomes the source.

    Returns
    -------
    dict
        Dictionaries, numbers and texts that YAML can contain.
    """
    friction = required_friction(drive)
    estimates = {**fit.estimates, **dynamic}
    names = ["mu", "mu_static", "b_c", "b_v", "b_oc", "b_ov"]
    if friction.law != "coulomb":
        # The Stribeck term follows the other coefficients of the gear mesh.
        names[2:2] = ["mu_stribeck", "stribeck_speed"]
    names += [name for name in ("dwell_constant", "memory") if getattr(friction, name)]
    table: JsonObject = {"law": friction.law, "source": f"identified from {evidence}"}
    for name in names:
        table[name] = _parameter_entry(
            drive, name, float(getattr(friction, name)), estimates.get(name)
        )
    if friction.identified_speed is not None:
        table["identified_speed"] = _quantity_text(
            drive, "identified_speed", friction.identified_speed
        )
    if friction.posterior is not None:
        table["posterior"] = _posterior_entry(friction.posterior)
    return table


def _posterior_entry(posterior: Posterior) -> JsonObject:
    """Build the content of the key "posterior" of the friction.

    Rows of numbers become one text each, because YAML reads it much faster than a list.

    Parameters
    ----------
    posterior : Posterior
        Equally likely parameter sets, and the ripple of the torque.

    Returns
    -------
    dict
        Dictionaries, numbers and texts that YAML can contain.
    """
    draws = {name: _joined_numbers(posterior.column(name)) for name in posterior.names}
    table: JsonObject = {"scatter": f"{posterior.scatter:.6g} N*m", "common": posterior.common}
    if posterior.speeds:
        table |= {
            "speeds": _joined_numbers(posterior.speeds),
            "departures": _joined_numbers(posterior.departures),
        }
    for name in POSTERIOR_PART_TYPES:
        component = getattr(posterior, name)
        if component is not None:
            fields = dict(vars(component))
            for key, value in fields.items():
                if not isinstance(value, bool):
                    fields[key] = _joined_numbers(value)
            table[name] = fields
    table["draws"] = draws
    return table


def _joined_numbers(values: Iterable[float]) -> str:
    """Join numbers with six significant digits in one text, separated by spaces.

    Parameters
    ----------
    values : iterable of float
        The numbers.

    Returns
    -------
    str
        The text.
    """
    return " ".join(f"{value:.6g}" for value in values)


def _parameter_entry(
    drive: Drive, name: str, value: float, estimate: Estimate | None
) -> JsonObject:
    """Build the entry of one parameter in the drive file.

    Parameters
    ----------
    drive : Drive
        Drive, whose kind of motion (rotating or sliding) determines the unit.
    name : str
        Name of the parameter.
    value : float
        Value in SI units.
    estimate : Estimate or None
        Estimate with its interval. None if the parameter was not identified.

    Returns
    -------
    dict
        The keys `value` and `source`.
    """
    return {"value": _quantity_text(drive, name, value), "source": _source_text(name, estimate)}


def _source_text(name: str, estimate: Estimate | None) -> str:
    """Describe where the value of a parameter comes from.

    Parameters
    ----------
    name : str
        Name of the parameter.
    estimate : Estimate or None
        Estimate with its interval. None if the parameter was not identified.

    Returns
    -------
    str
        Text of the key `source`, with the 95 % interval of an identified parameter.
    """
    if estimate is None:
        return "the law's value as speed tends to 0" if name == "mu_static" else "not identified"
    if estimate.fixed and name in ("mu_static", "memory"):
        return "as the torque-velocity map gives it"
    if estimate.fixed:
        return "given, not identified"
    text = f"identified, 95 % interval {estimate.low:.4g} to {estimate.high:.4g}"
    if not estimate.separable:
        text += ", not determined by the data alone"
    return text


def parameter_unit(drive: Drive, name: str) -> str | None:
    """Return the SI unit of a parameter of a drive.

    Parameters
    ----------
    drive : Drive
        Drive, whose kind of motion (rotating or sliding) determines the unit of its output.
    name : str
        Name of a field of `Rig`, `Drive` or `Friction`.

    Returns
    -------
    str or None
        Unit as text, such as `N*m`. None for a dimensionless parameter.
    """
    quantities = field_quantities(Rig) | field_quantities(Drive) | field_quantities(Friction)
    quantity = quantities.get(name)
    kind = quantity and QUANTITY_KINDS.get(unit_kind(quantity, drive.slides))
    return kind.unit if kind else None


def _quantity_text(drive: Drive, name: str, value: float) -> Any:
    """Format a value with eight significant digits and its unit.

    Parameters
    ----------
    drive : Drive
        Drive, whose kind of motion determines the unit.
    name : str
        Name of the parameter.
    value : float
        Value in SI units.

    Returns
    -------
    str or float
        Text such as `0.0012 N*m`, or a number for a dimensionless parameter.
    """
    unit = parameter_unit(drive, name)
    return float(f"{value:.8g}") if unit is None else f"{value:.8g} {unit}"
