"""The document, computed and written once for all tests of this folder."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from paper_cases import RECORDINGS, ROOT, Made

from ssm_planner.paper.document import compute, write
from ssm_planner.paper.published import Inputs, read_inputs


@pytest.fixture(scope="session")
def inputs() -> Inputs:
    return read_inputs(ROOT / "problems", RECORDINGS)


@pytest.fixture(scope="session")
def made(inputs: Inputs, tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("results") / "paper"
    document = compute(inputs)
    return Made(inputs, document, folder, write(document, folder))
