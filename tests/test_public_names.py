"""The public names of the package exist and work in any order of imports.

Importing the package loads no other module.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
from pathlib import Path
from typing import Any, TypeVar

import pytest

import ssm_planner
from ssm_planner.cli import main
from ssm_planner.deprecation import Renamed
from ssm_planner.errors import TrajectoryError
from tests.support.cli import python
from tests.support.paths import ROOT

NAMES = set(ssm_planner.__all__)
HOMES = {
    alias.name: f"ssm_planner.{node.module}"
    for node in ast.walk(ast.parse(Path(ssm_planner.__file__).with_suffix(".pyi").read_text()))
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
}
"""Modules that define the public names."""
FUNCTIONS = {name for name in NAMES if inspect.isfunction(getattr(ssm_planner, name))}
EVERY = "import pkgutil, importlib, ssm_planner\n" + (
    "for found in pkgutil.walk_packages(ssm_planner.__path__, 'ssm_planner.'):\n"
    "    if not found.name.endswith('__main__'): importlib.import_module(found.name)\n"
)
CALLABLE = f"assert all(callable(getattr(ssm_planner, name)) for name in {sorted(FUNCTIONS)})\n"


def passes(code: str) -> None:
    done = python("-c", code)
    assert done.returncode == 0, done.stderr


def test_these_names_and_no_others() -> None:
    assert len(ssm_planner.__all__) == len(NAMES)
    assert set(dir(ssm_planner)) == set(HOMES) == NAMES
    assert {
        *(
            "load_problem",
            "load_study",
            "study",
            "audit_study",
            "load_robot",
            "load_drive",
            "load_motor",
            "load_plan",
            "plan",
            "check",
            "prove",
            "identify",
            "design_session",
            "predict",
        ),
        *("size", "export", "ik", "fk", "workspace", "design_region", "compare", "report", "film"),
        *("schema", "template", "reproduce", "serve_view"),
        *("simulate", "retime", "controlled_stops", "check_speeds", "load_controller"),
        *("jacobian", "inverse_dynamics", "motor_torque"),
    } == FUNCTIONS
    with pytest.raises(AttributeError, match="nonsense"):
        ssm_planner.nonsense  # noqa: B018


def test_the_version_is_the_packages() -> None:
    stated = re.search(
        r'^version = "(.+)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.M
    )
    cited = re.search(r"^version: (.+)", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    assert stated is not None
    assert cited is not None
    assert ssm_planner.__version__ == stated[1] == cited[1]
    assert f"## {stated[1]}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_names_come_from_the_modules_that_define_them() -> None:
    for name, module in HOMES.items():
        value = getattr(importlib.import_module(module), name)
        assert getattr(ssm_planner, name) is value


def words(annotation: ast.expr | None) -> set[str]:
    """Return the names in an annotation. The metadata of an Annotated type are left out."""
    if annotation is None:
        return set()
    if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
        return words(ast.parse(annotation.value, mode="eval").body)
    if (
        isinstance(annotation, ast.Subscript)
        and isinstance(annotation.value, ast.Name)
        and annotation.value.id == "Annotated"
    ):
        assert isinstance(annotation.slice, ast.Tuple)
        return words(annotation.slice.elts[0])
    if isinstance(annotation, ast.Name):
        return {annotation.id}
    children = (child for child in ast.iter_child_nodes(annotation) if isinstance(child, ast.expr))
    return set().union(*map(words, children))


def in_signature(node: ast.FunctionDef) -> set[str]:
    a = node.args
    arguments = [
        *a.posonlyargs,
        *a.args,
        *a.kwonlyargs,
        *(item for item in (a.vararg, a.kwarg) if item),
    ]
    return set().union(words(node.returns), *(words(item.annotation) for item in arguments))


def in_class(node: ast.ClassDef) -> set[str]:
    """Return the names in the annotations of public fields, methods and properties."""
    result: set[str] = set()
    for part in node.body:
        if (
            isinstance(part, ast.AnnAssign)
            and isinstance(part.target, ast.Name)
            and part.target.id[0] != "_"
        ):
            result |= words(part.annotation)
        if isinstance(part, ast.FunctionDef) and (part.name[0] != "_" or part.name == "__init__"):
            result |= in_signature(part)
    return result


def of_this_package(module: str) -> set[str]:
    """Return the classes and types that a module defines or imports from the package."""
    tree = ast.parse(
        Path(importlib.import_module(module).__file__ or "").read_text(encoding="utf-8")
    )
    taken = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ssm_planner")
        for alias in node.names
    }
    result = {node.name for node in tree.body if isinstance(node, ast.ClassDef)}
    types = {
        node.targets[0].id
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }
    return taken | result | types


@pytest.mark.parametrize("name", sorted(NAMES))
def test_every_name_in_a_public_signature_is_public(name: str) -> None:
    value = getattr(ssm_planner, name)
    kinds = (
        [value]
        if inspect.isfunction(value)
        else inspect.getmro(value)
        if inspect.isclass(value)
        else []
    )
    for kind in kinds:
        if kind.__module__.startswith("ssm_planner"):
            node = ast.parse(inspect.cleandoc("\n" + inspect.getsource(kind))).body[0]
            result = in_class(node) if isinstance(node, ast.ClassDef) else in_signature(node)  # type: ignore[arg-type]
            result &= of_this_package(kind.__module__)
            home = vars(importlib.import_module(kind.__module__))
            assert not {item for item in result - NAMES if not isinstance(home.get(item), TypeVar)}


def test_the_walk_sees_fields_methods_and_arguments() -> None:
    tree = ast.parse(
        "class A:\n    x: B | None\n    _y: C\n    def f(self, z: 'D') -> E: ...\n    def _g(self) -> F: ..."
    )
    assert in_class(tree.body[0]) == {"B", "D", "E"}  # type: ignore[arg-type]


OLD_NAMES = [
    (name, old, alias.new)
    for name in sorted(NAMES)
    if inspect.isclass(getattr(ssm_planner, name))
    for old, alias in vars(getattr(ssm_planner, name)).items()
    if isinstance(alias, Renamed)
]


@pytest.mark.parametrize(("name", "old", "new"), OLD_NAMES)
def test_an_old_name_of_an_attribute_still_works_and_warns(name: str, old: str, new: str) -> None:
    owner = getattr(ssm_planner, name)
    if not hasattr(owner, new):  # The class lacks a field without default.
        owner = object.__new__(owner)
        object.__setattr__(owner, new, "value")
    with pytest.warns(DeprecationWarning, match=f"^{name}.{old} is now {new}$") as caught:
        value = getattr(owner, old)
    assert value == getattr(owner, new)
    assert caught[0].filename == __file__


def test_old_names_are_found() -> None:
    assert ("Plan", "doubt", "uncertified_reason") in OLD_NAMES
    assert ("Limit", "allows", "contains") in OLD_NAMES


def test_no_module_takes_a_name_away() -> None:
    assert not NAMES & {module.name for module in pkgutil.iter_modules(ssm_planner.__path__)}


@pytest.mark.parametrize(
    "code",
    [
        f"import ssm_planner\n{CALLABLE}{EVERY}{CALLABLE}",
        f"{EVERY}{CALLABLE}",
        f"from ssm_planner import *\nplan, export\n{EVERY}{CALLABLE}assert plan is ssm_planner.plan",
    ],
    ids=["before every module", "after every module", "by a star"],
)
def test_imports_work_in_any_order(code: str) -> None:
    passes(code)


def test_importing_the_package_loads_nothing() -> None:
    passes(
        "import sys, ssm_planner\nassert not [m for m in sys.modules if m.startswith(('ssm_planner.', 'numpy', 'casadi'))]"
    )


def test_a_session_in_python(tmp_path: Path) -> None:
    """The values that one function returns agree with those of the other functions.

    The command agrees with them too.
    """
    problem = ssm_planner.load_problem(ROOT / "problems/tilt_insert.yaml")
    assert (
        problem.robot.name
        == ssm_planner.load_robot(ROOT / "problems/robots/vitreoretinal.yaml").name
    )
    plan = ssm_planner.plan(problem)
    assert plan.passed
    result = ssm_planner.check(plan)
    assert result.to_dict() == plan.certificate.to_dict()
    assert (
        ssm_planner.check(plan.trajectory, problem.robot, problem.task_limits).to_dict()
        == result.to_dict()
    )
    assert ssm_planner.size(plan).to_dict() == plan.sizing.to_dict()
    files, manifest = ssm_planner.export(plan, "csv", tmp_path / "csv")
    assert manifest["verified"] is True
    assert ssm_planner.check(files["trajectory.csv"], problem.robot, problem.task_limits).passed
    assert (
        main(
            [
                "check",
                str(files["trajectory.csv"]),
                "--problem",
                str(ROOT / "problems/tilt_insert.yaml"),
            ]
        )
        == 0
    )


def test_candidates_and_conditions_of_size() -> None:
    motor = ROOT / "problems/motors/maxon_ecx_speed_13_m.yaml"
    sizing = ssm_planner.size(
        ROOT / "results/tilt_insert/plan.json", {"insertion": [motor]}, pause=1.0
    )
    assert sizing.conditions.pause == 1.0
    assert [verdict.joint for verdict in sizing.verdicts] == ["roll", "tilt", "insertion"]


def test_a_trajectory_needs_a_robot(tmp_path: Path) -> None:
    file = tmp_path / "motion.csv"
    file.touch()
    with pytest.raises(TrajectoryError, match="does not name a robot"):
        ssm_planner.check(file)


def test_the_folder_of_a_plan_is_checked_like_its_file() -> None:
    folder = ROOT / "results/tilt_insert"
    assert ssm_planner.check(folder) == ssm_planner.check(folder / "plan.json")
    assert ssm_planner.check(folder, speed=0.5) == ssm_planner.check(
        folder / "plan.json", speed=0.5
    )


@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
def test_identify_and_predict_give_values() -> None:
    result = ssm_planner.identify(ROOT / "problems/drives/rig3_worm.yaml")
    assert result.drive.friction is not None
    assert result.to_dict()["law"] == result.fit.law


AS_A_LIBRARY = """
import ssm_planner as ssm
from ssm_planner import deg, mm

robot = ssm.load_robot("vitreoretinal")            # a shipped name, or a file
problem = ssm.Problem(robot, start=ssm.Task(tilt=-85 * deg),
    motion=[ssm.Straight(tilt=-135 * deg), ssm.Dwell(0.2), ssm.Straight(depth=20 * mm)],
    limits=[ssm.TaskRange("tilt", -139 * deg, -81 * deg), ssm.TipSpeed(25 * mm)])
plan = ssm.plan(problem)
plan.save("out")                                   # the same folder as the command's
ssm.load_plan("out").trajectory.sample(0.001)
"""


@pytest.mark.slow
def test_a_problem_made_in_python_is_planned_saved_and_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(AS_A_LIBRARY, names)
    assert names["plan"].passed
    assert {"plan.json", "report.html", "trajectory.csv"} < {
        path.name for path in Path("out").iterdir()
    }
    judged = names["plan"].cross_checked()  # `save` does the same
    assert ssm_planner.load_plan("out").to_json() == judged.to_json()
