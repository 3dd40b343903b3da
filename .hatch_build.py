"""Hatchling's hook: the libraries of ssm_planner/native go into the wheel, which is of this system then, else of any."""

from __future__ import annotations

import runpy
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class NativeHook(BuildHookInterface[Any]):
    """Called for wheels, and for editable installs, whose libraries stay in the source tree."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and say which files belong to the wheel and for which system it is."""
        made: list[Path] = runpy.run_path(str(Path(self.root, ".native_build.py")))["build"]()
        if version == "editable" or not made:
            return
        build_data["artifacts"] += [path.relative_to(self.root).as_posix() for path in made]
        build_data["pure_python"] = False
        build_data["tag"] = "py3-none-" + sysconfig.get_platform().replace("-", "_").replace(
            ".", "_"
        )
