"""The fixture `made` writes the document once for all tests of this folder."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from paper_reproduction.published import Inputs, read_inputs
from tests.support.cli import python
from tests.support.once import made_once
from tests.support.paper_cases import Made
from tests.support.paths import PROBLEMS
from tests.support.recordings import RECORDINGS

VALUES = "document.pickle"
KEEPING = """
import pickle, sys
from pathlib import Path
from ssm_planner.cli import main
from ssm_planner.reproduction import EXAMPLES_FOLDER
sys.path.append(str(EXAMPLES_FOLDER))
from paper_reproduction import document

write = document.write

def keep(values, *others):
    Path(kept).write_bytes(pickle.dumps(values))
    return write(values, *others)

kept = sys.argv.pop(1)
document.write = keep
sys.exit(main())
"""
"""Program that runs a command and also stores the document as a Python object."""


@pytest.fixture(scope="session")
def inputs() -> Inputs:
    return read_inputs(PROBLEMS, RECORDINGS)


@pytest.fixture(scope="session")
def made(inputs: Inputs, tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Return the document of the command, which runs in a separate process."""

    def make(folder: Path) -> None:
        words = ("reproduce", "-o", folder, "--recordings", RECORDINGS)
        done = python("-c", KEEPING, folder / VALUES, *words)
        assert done.returncode == 0, done.stderr

    results = made_once(tmp_path_factory, "results", make)
    document, folder = pickle.loads((results / VALUES).read_bytes()), results / "paper"
    return Made(inputs, document, folder, {path.name: path for path in folder.iterdir()})


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test that needs the whole document as slow because its computation takes long."""
    for item in items:
        if "made" in getattr(item, "fixturenames", ()):
            item.add_marker("slow")
