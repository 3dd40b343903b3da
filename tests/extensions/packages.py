"""The packages in examples/extensions, as their pyproject.toml describes them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

from tests.support.paths import ROOT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

GROUP = "ssm_planner.formats"


class Package(NamedTuple):
    folder: Path
    name: str
    form: str
    """Name of its export format."""
    entry: str
    """Entry point of the format, module:object."""


def _packages() -> dict[str, Package]:
    """Return the packages that add an export format, by the name of their folder."""
    packages = {}
    for file in sorted((ROOT / "examples/extensions").glob("*/pyproject.toml")):
        project = tomllib.loads(file.read_text(encoding="utf-8"))["project"]
        for form, entry in project.get("entry-points", {}).get(GROUP, {}).items():
            packages[file.parent.name] = Package(file.parent, project["name"], form, entry)
    return packages


PACKAGES = _packages()
"""Packages with an export format by the name of their folder."""


def install(site: Path) -> str:
    """Put all packages on the path as pip would, and return the value of PYTHONPATH."""
    for package in PACKAGES.values():
        info = site / f"{package.name.replace('-', '_')}-0.1.0.dist-info"
        info.mkdir(parents=True)
        metadata = f"Metadata-Version: 2.1\nName: {package.name}\nVersion: 0.1.0\n"
        (info / "METADATA").write_text(metadata, encoding="utf-8")
        text = f"[{GROUP}]\n{package.form} = {package.entry}\n"
        (info / "entry_points.txt").write_text(text, encoding="utf-8")
    return ":".join(map(str, [ROOT, site, *(package.folder for package in PACKAGES.values())]))
