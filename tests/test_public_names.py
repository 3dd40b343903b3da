"""The public Python names: there, alone, in any order of imports, and instant to import."""

from __future__ import annotations

import pkgutil
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ssm_planner
from ssm_planner.cli import main
from ssm_planner.errors import TrajectoryError

ROOT = Path(__file__).parent.parent
UNITS = {"deg", "mm", "mNm", "ms", "rpm"}
FUNCTIONS = {
    "load_problem", "load_robot", "load_drive", "load_motor", "plan", "check", "identify", "predict", "size", "export"
}  # fmt: skip
NAMES = FUNCTIONS | UNITS
EVERY = "import pkgutil, importlib, ssm_planner\n" + (
    "for found in pkgutil.walk_packages(ssm_planner.__path__, 'ssm_planner.'):\n"
    "    if not found.name.endswith('__main__'): importlib.import_module(found.name)\n"
)
CALLABLE = f"assert all(callable(getattr(ssm_planner, name)) for name in {sorted(FUNCTIONS)})\n"


def run(code: str) -> None:
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=ROOT)


def test_these_names_and_no_others() -> None:
    assert set(ssm_planner.__all__) == set(dir(ssm_planner)) == NAMES
    with pytest.raises(AttributeError, match="nonsense"):
        ssm_planner.nonsense  # noqa: B018


def test_no_module_takes_a_name_away() -> None:
    assert not NAMES & {found.name for found in pkgutil.iter_modules(ssm_planner.__path__)}


@pytest.mark.parametrize(
    "code",
    [
        f"import ssm_planner\n{CALLABLE}{EVERY}{CALLABLE}",
        f"{EVERY}{CALLABLE}",
        f"from ssm_planner import *\nplan, export\n{EVERY}{CALLABLE}assert plan is ssm_planner.plan",
    ],
    ids=["before every module", "after every module", "by a star"],
)
def test_in_any_order_of_imports(code: str) -> None:
    run(code)


def test_importing_the_package_loads_nothing() -> None:
    run(
        "import sys, ssm_planner\nassert not [m for m in sys.modules if m.startswith(('ssm_planner.', 'numpy', 'casadi'))]"
    )


def test_a_session_in_python(tmp_path: Path) -> None:
    """The README's lines; what they return agrees with itself and with the command."""
    problem = ssm_planner.load_problem(ROOT / "problems/tilt_insert.yaml")
    assert problem.robot.name == ssm_planner.load_robot(ROOT / "problems/robots/vitreoretinal.yaml").name
    plan = ssm_planner.plan(problem)
    assert plan.passed
    found = ssm_planner.check(plan)
    assert found.to_dict() == plan.certificate.to_dict()
    assert ssm_planner.check(plan.trajectory, problem.robot, problem.task_limits).to_dict() == found.to_dict()
    assert ssm_planner.size(plan).to_dict() == plan.sizing.to_dict()
    files, manifest = ssm_planner.export(plan, "csv", tmp_path / "csv")
    assert manifest["verified"] is True
    assert ssm_planner.check(files["trajectory.csv"], problem.robot, problem.task_limits).passed
    assert main(["check", str(files["trajectory.csv"]), "--problem", str(ROOT / "problems/tilt_insert.yaml")]) == 0


def test_candidates_and_conditions_of_size() -> None:
    motor = ROOT / "problems/motors/maxon_ecx_speed_13_m.yaml"
    sizing = ssm_planner.size(ROOT / "results/tilt_insert/plan.json", {"insertion": [motor]}, pause=1.0)
    assert sizing.conditions.pause == 1.0
    assert [verdict.joint for verdict in sizing.verdicts] == ["roll", "tilt", "insertion"]


def test_a_trajectory_needs_a_robot(tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError, match="which robot"):
        ssm_planner.check(tmp_path / "motion.csv")


def test_identify_and_predict_give_values() -> None:
    found = ssm_planner.identify(ROOT / "problems/drives/rig3_worm.yaml")
    assert found.drive.friction is not None
    assert found.to_dict()["law"] == found.fit.law


def test_the_lines_in_the_readme_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = re.search(
        r"## From Python\n\n```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL
    )
    assert found is not None
    shutil.copytree(ROOT / "problems", tmp_path / "problems")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(found[1], names)
    assert names["files"]
