"""Schema of a scan: spots on the retina."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import model_validator

from ssm_planner.problem.schema.common import Model, quantity, vector, wrong
from ssm_planner.problem.schema.points import TaskModel

KEYS = {"raster": ("rows", "columns"), "ring": ("diameter",), "triple ring": ("diameters",)}
"""What each pattern has beside the common keys."""
MOST = 50
Size = Annotated[float, quantity("length", above=0)]
Count = Annotated[float, quantity("number", at_least=1)]


class ScanModel(Model):
    """See values.Scan."""

    pattern: Literal["raster", "ring", "triple ring"]
    at: TaskModel
    distance: Size
    spacing: Size = 0.6e-3
    dwell: Annotated[float, quantity("time", at_least=0)] = 0.0
    diameter: Size | None = None
    diameters: Annotated[tuple[float, float, float], vector("length", "length", "length")] = (1e-3, 2e-3, 3e-3)
    rows: Count | None = None
    columns: Count | None = None

    @model_validator(mode="before")
    @classmethod
    def _keys_of_its_pattern(cls, data: Any) -> Any:
        pattern = data.get("pattern") if isinstance(data, dict) else None
        if pattern not in KEYS:
            return data
        for key in (key for other, keys in KEYS.items() if other != pattern for key in keys):
            if key in data:
                raise wrong(f"not for the pattern {pattern!r}", f"for it: {', '.join(KEYS[pattern])}", key)
        for key in KEYS[pattern]:
            if key not in data and key != "diameters":
                raise wrong(f"missing: the pattern {pattern!r} needs it", None, key)
        at = data.get("at")
        if isinstance(at, dict) and "tilt" not in at:
            raise wrong("missing: no pattern is there without a tilt", "roll, tilt, spin", "at")
        if isinstance(at, dict) and "depth" in at:
            raise wrong("depth: how deep the tip goes is what distance says", "roll, tilt, spin", "at")
        return data

    @model_validator(mode="after")
    def _sizes(self) -> ScanModel:
        for name in ("rows", "columns"):
            count = getattr(self, name)
            if count is not None and (count != int(count) or count > MOST):
                raise wrong("not a count", f"a whole number from 1 to {MOST}", name)
        low, middle, high = self.diameters
        if not 0 < low < middle < high:
            raise wrong("not three rings one around the other", "three growing lengths", "diameters")
        return self
