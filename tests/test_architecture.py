"""The package consists of ordered parts that import only from themselves and from earlier parts.

No files import each other in a circle.
"""

from __future__ import annotations

import ast
from functools import cache

import pytest

from ssm_planner.reproduction import EXAMPLES_FOLDER, PROGRAM_PACKAGE
from tests.support.paths import PACKAGE

ROOMS = (
    *(
        "errors",
        "deprecation",
        "registry",
        "arguments",
        "representation",
        "typing",
        "progress",
        "package_table",
        "units",
        "display",
        "atomic",
        "publishing",
        "children",
        "native",
        "trajectory",
        "toppra_passes",
        "problem",
        "codegen",
        "interior",
        "kinematics",
        "dynamics",
        "elements",
        "loading",
    ),
    *(
        "planning",
        "verification",
        "stopping",
        "sizing",
        "identification",
        "plans",
        "formats",
        "simulation",
        "laws",
        "comparison",
    ),
    *(
        "reporting",
        "pipeline",
        "studies",
        "templates",
        "api",
        "view",
        "reproduction",
        "cli",
        "__main__",
    ),
)
"""Parts of the package. A part imports only from itself and from earlier parts."""
STRANGERS = {"planning", "verification"}
"""These parts never import each other, so that the check can find errors of the planner."""
HEAVY = {"casadi", "toppra", "matplotlib", "pint", "scipy", "pydantic", "jinja2"}
FILES = {
    ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): file
    for file in sorted(PACKAGE.rglob("*.py"))
}


FACES = {
    file.parent.relative_to(PACKAGE.parent).as_posix().replace("/", "."): {
        alias.name: f"ssm_planner.{file.parent.name}.{node.module}"
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    for file in sorted(PACKAGE.glob("*/__init__.pyi"))
}
"""The public names of each part, with the modules that define them."""


def imports(name: str, *, everywhere: bool = True) -> set[str]:
    """Return the modules that a file imports.

    With `everywhere`, imports inside functions and for type checkers count too. Otherwise, only
    imports at the top level of the file count.
    """
    tree = ast.parse(FILES[name].read_text(encoding="utf-8"))
    result: set[str] = set()
    for node in ast.walk(tree) if everywhere else iter(tree.body):
        if isinstance(node, ast.Import):
            result.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = {alias.name for alias in node.names}
            face = FACES.get(node.module, {})
            of_names = {f"{node.module}.{alias}" for alias in names} & set(FILES)
            of_names |= {face[alias] for alias in names & set(face)}
            result.update(of_names or {node.module})
    return result


def room(name: str) -> str:
    return name.split(".")[1]


MODULES = [name for name in FILES if name != "ssm_planner"]


@cache
def neighbours(name: str) -> set[str]:
    """Return the other modules of the package that a module imports."""
    return imports(name) & set(FILES) - {name}


def test_every_name_of_a_face_exists_and_is_used_by_another_room() -> None:
    used = {room_name: set() for room_name in FACES}
    users = {name: FILES[name] for name in MODULES}
    users |= {file.stem: file for file in (EXAMPLES_FOLDER / PROGRAM_PACKAGE).glob("*.py")}
    for name, file in users.items():
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                of = ".".join(node.module.split(".")[:2])
                if of in FACES and not name.startswith(of):
                    used[of] |= {alias.name for alias in node.names}
    for of, face in FACES.items():
        assert set(face) <= used[of]
        for name, module in face.items():
            assert hasattr(__import__(module, fromlist=[name]), name), f"{module} has no {name}"


def test_every_room_has_its_place() -> None:
    assert {room(name) for name in MODULES} == set(ROOMS)


@pytest.mark.parametrize("name", MODULES)
def test_imports_go_one_way(name: str) -> None:
    own_room = room(name)
    others = neighbours(name)
    assert "ssm_planner" not in others or own_room == "cli", f"{name} imports the public names"
    for other in others - {"ssm_planner"}:
        assert ROOMS.index(room(other)) <= ROOMS.index(own_room), f"{name} imports {other}"
        assert {own_room, room(other)} != STRANGERS, f"{name} imports {other}"


FOUND_BY_NAME = {("plans", "pipeline")}
"""Pairs of parts. The first part finds a function of the second part by its name during a call."""


@pytest.mark.parametrize("name", MODULES)
def test_modules_of_higher_rooms_are_found_by_name_only_where_it_is_declared(name: str) -> None:
    own_room = room(name)
    for node in ast.walk(ast.parse(FILES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            module, colon, _ = node.value.partition(":")
            if colon and module in MODULES and ROOMS.index(room(module)) > ROOMS.index(own_room):
                assert (own_room, room(module)) in FOUND_BY_NAME, (
                    f"{name} finds {module} by its name"
                )


def test_no_circle_of_files() -> None:
    left = {name: neighbours(name) for name in MODULES}
    while True:
        ready = {name for name, others in left.items() if not others & set(left)}
        if not ready:
            break
        for name in ready:
            del left[name]
    assert not left, f"files that import each other, or import such files: {sorted(left)}"


@pytest.mark.parametrize("name", ["ssm_planner.cli", "ssm_planner", "ssm_planner.errors"])
def test_help_is_instant_because_nothing_heavy_is_imported(name: str) -> None:
    reached = imports(name, everywhere=False)
    assert not {module.split(".")[0] for module in reached} & HEAVY
    assert not {other for other in reached if other in FILES} - {
        "ssm_planner.errors",
        "ssm_planner.package_table",
        "ssm_planner",
    }


LIMIT_NAMES = {
    *(
        "motor speed",
        "motor torque",
        "continuous torque",
        "nut contact",
        "self-locking",
        "tip speed",
        "insertion speed",
    ),
    *(f"{name} rate" for name in ("roll", "tilt", "spin")),
    *(
        "retina clearance",
        "lens clearance",
        "position jump",
        "velocity jump",
        "acceleration jump",
        " range",
        " rate",
    ),
}
HEADINGS = {"ssm_planner.plans"}
"""Files in which these words are keys of the table of units in plan.json."""


@pytest.mark.parametrize(
    "name",
    [name for name in FILES if name != "ssm_planner.problem.limits" and name not in HEADINGS],
)
def test_names_of_limits_stand_in_one_file_and_nobody_decodes_them(name: str) -> None:
    for node in ast.walk(ast.parse(FILES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            assert node.value not in LIMIT_NAMES, (
                f"{name}:{node.lineno} names a limit: {node.value!r}"
            )
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            method, of = node.func.attr, node.func.value
            decodes = method in (
                "removesuffix",
                "removeprefix",
                "endswith",
                "startswith",
                "split",
                "partition",
            )
            is_name = (
                isinstance(of, ast.Attribute)
                and of.attr in ("name", "constraint")
                and "limit" in ast.dump(of.value)
            )
            assert not (decodes and is_name), f"{name}:{node.lineno} decodes the name of a limit"
