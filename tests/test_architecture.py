"""Who may import whom: problem ← model ← {identification, planning, verify, sizing} ← outcome ← {exports, report} ← run."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "ssm_planner"
BASE = {"errors"}
ALLOWED = {
    "problem": set(),
    "model": {"problem"},
    "identification": {"problem", "model"},
    "planning": {"problem", "model"},
    "verify": {"problem", "model"},
    "sizing": {"problem", "model"},
    "outcome": {"problem", "model", "planning", "verify", "sizing"},
    "exports": {"problem", "model", "planning", "verify", "sizing", "identification", "outcome", "report"},
    "report": {"problem", "model", "planning", "verify", "sizing", "identification", "outcome", "exports"},
    "view": {"problem", "model", "planning", "verify", "sizing", "outcome", "exports", "report", "run"},
    "relaxations": {"problem", "planning"},
    "relax": {"problem", "planning", "relaxations"},
    "tightening": {"problem", "verify"},
    "run": {"problem", "model", "planning", "verify", "sizing", "outcome", "exports", "report", "relax", "tightening"},
    "api": {"problem", "model", "sizing", "verify", "outcome", "exports"},
    "paper": {"problem", "model", "identification", "sizing", "outcome", "exports", "report", "run"},
    "commands": {
        "problem",
        "model",
        "identification",
        "planning",
        "verify",
        "sizing",
        "outcome",
        "exports",
        "report",
        "run",
        "view",
        "paper",
    },
}
HEAVY = {"casadi", "toppra", "matplotlib", "pint", "scipy", "pydantic"}


def imports(file: Path, *, everywhere: bool = True) -> set[str]:
    """Modules that a file imports; with everywhere False only when it is itself imported."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    nodes = ast.walk(tree) if everywhere else iter(tree.body)
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            if node.module == "ssm_planner":
                names.update(f"ssm_planner.{alias.name}" for alias in node.names)
    return names


def room(name: str) -> str | None:
    parts = name.split(".")
    return parts[1] if parts[0] == "ssm_planner" and len(parts) > 1 else None


@pytest.mark.parametrize("file", sorted(PACKAGE.rglob("*.py")), ids=lambda file: str(file.relative_to(PACKAGE)))
def test_imports_go_one_way(file: Path) -> None:
    here = file.relative_to(PACKAGE).parts[0].removesuffix(".py")
    if here in ("cli", "__init__", "__main__", "errors"):
        return
    reached = {room(name) for name in imports(file)} - {None, here} - BASE
    assert reached <= ALLOWED[here]


def test_planning_and_verify_do_not_know_each_other() -> None:
    assert "verify" not in ALLOWED["planning"]
    assert "planning" not in ALLOWED["verify"]


@pytest.mark.parametrize("name", ["cli.py", "__init__.py", "errors.py"])
def test_help_is_instant_because_nothing_heavy_is_imported(name: str) -> None:
    top = {module.split(".")[0] for module in imports(PACKAGE / name, everywhere=False)}
    assert not top & HEAVY
    assert not {room(module) for module in imports(PACKAGE / name, everywhere=False)} - {None, "errors"}
