"""What the files may say: strict pydantic models, which stand beside what reads them, and their JSON schema."""

from __future__ import annotations

from typing import Any, Literal


def json_schema(file: Literal["problem", "robot", "drive", "motor", "motorisation"]) -> dict[str, Any]:
    """JSON schema of a kind of file, for editors that complete and check YAML."""
    from pydantic import TypeAdapter

    from ssm_planner.loading.motorisation import MotorisationModel
    from ssm_planner.loading.motors import MotorModel
    from ssm_planner.loading.problems import ProblemModel
    from ssm_planner.loading.robots import RobotModel
    from ssm_planner.loading.schema.drive import AntibacklashScrewModel, LeadScrewModel, WormModel

    models: dict[str, Any] = {
        "problem": ProblemModel,
        "robot": RobotModel,
        "drive": WormModel | LeadScrewModel | AntibacklashScrewModel,
        "motor": MotorModel,
        "motorisation": MotorisationModel,
    }
    return TypeAdapter(models[file]).json_schema()
