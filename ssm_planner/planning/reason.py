"""Why there is no plan: a value that names constraint, joint, place, what is needed and what there is."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Reason:
    """SI units; joint and where are None where the whole motion is concerned."""

    constraint: str
    joint: str | None
    where: str | None
    required: float | None
    available: float | None
    relaxation: str | None
    message: str

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)
