"""The verdict on motors and gears in words, from the object that `size --json` prints and plan.json holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

Sizing = Mapping[str, Any]
ANSWERS = {True: "yes", False: "no", None: "not known"}


def motors_verdict(sizing: Sizing) -> tuple[str, str, str]:
    """("good", "bad" or "open", the verdict, its reason)."""
    motors, gears = sizing["motors"], sizing["gears"]
    placeholders = ", ".join(motor["joint"] for motor in motors if motor["placeholder"])
    without = ", ".join(sorted({gear["joint"] for gear in gears} - {motor["joint"] for motor in motors}))
    if sizing["adequate"] is False:
        return "bad", "Motors or gears do not suffice", "; ".join(_failures(sizing))
    if not gears:
        return "open", "Motors open", "no joint has a drive"
    if without:
        return "open", "Motors open", f"no motor given for {without}"
    if sizing["adequate"] is None:
        kept, open_ = _by_outcome(sizing)
        reasons = [
            f"{', '.join(kept)} are enough" if kept else "",
            f"not checked for want of figures: {', '.join(open_)}",
        ]
        reasons.append(f"placeholder figures: {placeholders}" if placeholders else "")
        return "open", "Motors suffice: not known", "; ".join(filter(None, reasons))
    if placeholders:
        return "open", "Motors suffice by placeholder figures", f"no verdict on the real ones of {placeholders}"
    return "good", "Motors and gears suffice", f"with at least {100 * sizing['confidence']:g} % each"


def missing_figures(sizing: Sizing) -> Iterator[tuple[str, str, str, str]]:
    """(joint, motor or gear, checks not made, figures they need) for every part of which something is not known."""
    of_gears = _gear_checks(sizing)
    for motor in sizing["motors"]:
        lacking = {name: needs for name, needs in motor["not_checked"].items() if name not in of_gears}
        if lacking:
            yield (motor["joint"], motor["motor"], *_lines(lacking))
    for gear in sizing["gears"]:
        if gear["not_checked"]:
            yield (gear["joint"], gear["drive"], *_lines(gear["not_checked"]))


def gear_margin(motor: Mapping[str, Any], sizing: Sizing) -> float | None:
    """The smallest margin of the gear that a motor drives; None where none could be checked."""
    margins = [margin for name, margin in motor["margins"].items() if name in _gear_checks(sizing)]
    return min((margin for margin in margins if margin is not None), default=None)


def _by_outcome(sizing: Sizing) -> tuple[list[str], list[str]]:
    """Checks that were made on every joint, and those that some joint lacks figures for; a gear's are one."""
    of_gears = _gear_checks(sizing)
    every: dict[str, bool] = {}
    for part in (*sizing["motors"], *sizing["gears"]):
        for name in dict.fromkeys((*part["margins"], *part["not_checked"])):
            word = "gear" if name in of_gears else name.replace("_", " ")
            every[word] = every.get(word, True) and name not in part["not_checked"]
    return [word for word, made in every.items() if made], [word for word, made in every.items() if not made]


def _failures(sizing: Sizing) -> list[str]:
    """Joint, check and margin of everything that does not suffice."""
    failed = {
        (motor["joint"], check["name"]): check["margin"]
        for motor in sizing["motors"]
        for check in motor["checks"]
        if check["passed"] is False
    }
    for gear in sizing["gears"]:
        if gear["adequate"] is False:
            failed.setdefault((gear["joint"], gear["binds"]), gear["margins"][gear["binds"]])
    return [f"{joint}: {name.replace('_', ' ')} {100 * margin:+.1f} %" for (joint, name), margin in failed.items()]


def _gear_checks(sizing: Sizing) -> set[str]:
    return {name for gear in sizing["gears"] for name in gear["margins"]}


def _lines(lacking: Mapping[str, str]) -> tuple[str, str]:
    figures = dict.fromkeys(figure for needs in lacking.values() for figure in needs.split(" and "))
    return ", ".join(name.replace("_", " ") for name in lacking), ", ".join(figures)
