"""Write the guard as C99 code beside the C export of a plan."""

from __future__ import annotations

from pathlib import Path

from ssm_planner.codegen import c_literal
from ssm_planner.display import jinja_environment, render_template
from ssm_planner.formats.c import ROBOT_FILE, comment_safe_text, export_c
from ssm_planner.plans import Plan
from ssm_planner.typing import JsonObject
from ssm_planner.verification import Certificate
from ssm_planner_guard.thresholds import Thresholds, thresholds_of
from ssm_planner_guard.twin import Cause

FILE = "guard"
"""Name of the files without suffix."""


def write(
    plan: Plan, certificate: Certificate, folder: Path, suffix: str, rate: float = 1000.0
) -> JsonObject:
    """Write the C export, guard.h and guard.c, and return the entries of the manifest.

    Parameters
    ----------
    plan : Plan
    certificate : Certificate
        Certificate of the plan. The code does not contain it.
    folder : Path
        Folder of the files.
    suffix : str
        Text that marks unverified files, before the extension.
    rate : float
        Ticks per second.

    Raises
    ------
    ExportError
        If the rate is out of range, or a motor or an encoder resolution is missing.
    """
    entries = export_c(plan, certificate, folder, suffix)
    thresholds = thresholds_of(plan, 1 / rate)
    remark = f"Exported with {comment_safe_text(plan.path.name)}, SHA-256 {plan.sha256}."
    for ending, text in zip("hc", c_guard(thresholds, remark, suffix), strict=True):
        (folder / f"{FILE}{suffix}.{ending}").write_text(text, encoding="utf-8")
    return {**entries, "guard": {"rate_hz": rate, "thresholds": _plain(thresholds)}}


def c_guard(limits: Thresholds, remark: str, suffix: str = "") -> tuple[str, str]:
    """Return the header and the source file of a guard. `remark` is part of their comments."""
    arrays = {name: x for name, x in _plain(limits).items() if isinstance(x, list)}
    driven = arrays.pop("driven")
    values = {
        "comment": f"/*\n * Guard of a motion. {remark}\n"
        " * The code allocates no memory. Its state is in the struct ssm_guard.\n */",
        "robot": f"{ROBOT_FILE}{suffix}.h",
        "header": f"{FILE}{suffix}.h",
        "limits": limits,
        "causes": list(Cause),
        "period": c_literal(limits.period),
        "lag": c_literal(limits.lag),
        "driven": [int(flag) for flag in driven],
        "tables": {name: [c_literal(x) for x in column] for name, column in arrays.items()},
    }
    templates = jinja_environment("ssm_planner_guard", escape=False)
    return (
        render_template(templates, f"{FILE}.h", **values),
        render_template(templates, f"{FILE}.c", **values),
    )


def _plain(limits: Thresholds) -> JsonObject:
    """Return the thresholds as JSON types."""
    return {
        name: value.tolist() if hasattr(value, "tolist") else value
        for name, value in vars(limits).items()
    }
