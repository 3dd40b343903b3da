"""The verdict on motors and gears in words, from the object that `size --json` prints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

GEAR = "gear"
"""One word for every check of a gear."""


def motors_verdict(sizing: Mapping[str, Any]) -> tuple[str, str, str]:
    """("good", "bad" or "open", the verdict, its reason)."""
    motors = sizing["motors"]
    placeholders = [motor["joint"] for motor in motors if motor["placeholder"]]
    if sizing["adequate"] is False:
        return "bad", "Motors or gears do not suffice", "; ".join(_failures(sizing))
    if not sizing["gears"]:
        return "open", "Motors open", "no joint has a drive"
    missing = [gear["joint"] for gear in sizing["gears"] if gear["joint"] not in {motor["joint"] for motor in motors}]
    if missing:
        return "open", "Motors open", f"no motor given for {', '.join(missing)}"
    if sizing["adequate"] is None:
        reasons = []
        kept = checks_by_outcome(sizing, made=True)
        if kept:
            reasons.append(f"{', '.join(kept)} within the limits")
        reasons.append(f"{', '.join(checks_by_outcome(sizing, made=False))} not checked: figures are missing")
        if placeholders:
            reasons.append(f"placeholder figures: {', '.join(placeholders)}")
        return "open", "Motors suffice: not known", "; ".join(reasons)
    sure = f"with at least {100 * sizing['confidence']:g} % each"
    if placeholders:
        return "open", "Motors suffice by placeholder figures", f"no verdict on the real ones of {', '.join(placeholders)}"
    return "good", "Motors and gears suffice", sure


def checks_by_outcome(sizing: Mapping[str, Any], made: bool) -> list[str]:
    """What is checked on every joint (made) or lacks figures on some, each named once, a gear's checks together."""
    lacking = {_word(name): None for part in (*sizing["motors"], *sizing["gears"]) for name in part["not_checked"]}
    if not made:
        return sorted(lacking, key=lambda word: word == GEAR)
    every = {_word(check["name"]): None for motor in sizing["motors"] for check in motor["checks"]}
    return [word for word in every if word not in lacking]


def missing_figures(sizing: Mapping[str, Any]) -> Iterable[tuple[str, str, str]]:
    """(joint, motor or gear, the checks that lack figures, and which) for every part of which something is not known."""
    parts = [(motor["joint"], motor["motor"], motor, False) for motor in sizing["motors"]]
    parts += [(gear["joint"], gear["drive"], gear, True) for gear in sizing["gears"]]
    for joint, name, part, is_gear in parts:
        lacking = {key: needs for key, needs in part["not_checked"].items() if (_word(key) == GEAR) == is_gear}
        if lacking:
            figures = dict.fromkeys(figure for needs in lacking.values() for figure in needs.split(" and "))
            checks = ", ".join(key.replace("_", " ") for key in lacking)
            yield f"{joint}: {name}", checks, ", ".join(figures)


def _failures(sizing: Mapping[str, Any]) -> list[str]:
    failed = [
        f"{motor['joint']}: {check['name'].replace('_', ' ')} {_percent(check['margin'])}"
        for motor in sizing["motors"]
        for check in motor["checks"]
        if check["passed"] is False
    ]
    judged = {motor["joint"] for motor in sizing["motors"]}
    for gear in sizing["gears"]:
        if gear["adequate"] is False and gear["joint"] not in judged:
            failed.append(f"{gear['joint']}: {gear['binds'].replace('_', ' ')} {_percent(min(_made(gear)))}")
    return failed


def _made(part: Mapping[str, Any]) -> list[float]:
    return [margin for margin in part["margins"].values() if margin is not None]


def _percent(margin: float) -> str:
    return f"{100 * margin:+.1f} %"


def _word(check: str) -> str:
    motor = ("torque", "speed", "continuous_torque", "voltage", "heat", "confidence", "rotor_inertia")
    return check.replace("_", " ") if check in motor else GEAR
