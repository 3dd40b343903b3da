"""Folders of the project, and the folder beside it that may hold recordings."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "ssm_planner"
PROBLEMS = ROOT / "problems"
RESULTS = ROOT / "results"
SHARED = ROOT.parent / "shared"
