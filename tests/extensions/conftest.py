from __future__ import annotations

import pkgutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from ssm_planner.formats.export import export
from ssm_planner.formats.format import Format
from ssm_planner.plans import Plan, load_plan
from ssm_planner.registry import Registry
from tests.extensions.packages import PACKAGES
from tests.support.once import made_once
from tests.support.paths import RESULTS


@pytest.fixture(scope="session")
def shipped() -> Plan:
    """Return the shipped plan, which all extensions export."""
    return load_plan(RESULTS / "tilt_insert")


@pytest.fixture(scope="session")
def exported(tmp_path_factory: pytest.TempPathFactory, shipped: Plan) -> Callable[[str], Path]:
    """Return a function that exports the shipped plan in the format of a package.

    The function returns the folder, and exports each format only once.
    """

    def folder_of(name: str) -> Path:
        package = PACKAGES[name]
        if str(package.folder) not in sys.path:
            sys.path.insert(0, str(package.folder))
        form: Format = pkgutil.resolve_name(package.entry)

        def make(folder: Path) -> None:
            with pytest.MonkeyPatch.context() as patch:
                registry = Registry("nobody.provides", "export format", form)
                patch.setattr("ssm_planner.formats.export.FORMATS", registry)
                export(shipped, form.name, folder / "export")

        return made_once(tmp_path_factory, f"export_{form.name}", make) / "export"

    return folder_of
