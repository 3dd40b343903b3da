"""The document, computed and written once for all tests of this folder."""

from __future__ import annotations

import pytest

from ssm_planner.paper.document import compute, write
from ssm_planner.paper.published import Inputs, read_inputs
from tests.support.paper_cases import Made
from tests.support.paths import PROBLEMS
from tests.support.recordings import RECORDINGS


@pytest.fixture(scope="session")
def inputs() -> Inputs:
    return read_inputs(PROBLEMS, RECORDINGS)


@pytest.fixture(scope="session")
def made(inputs: Inputs, tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("results") / "paper"
    document = compute(inputs)
    return Made(inputs, document, folder, write(document, folder))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave to the second tier every test that needs the whole document, which takes long to compute."""
    for item in items:
        if "made" in getattr(item, "fixturenames", ()):
            item.add_marker("slow")
