"""The file constraints.txt pins every package that the project and its extras need.

A new installation then gets the versions that were tested.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, distribution

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.support.paths import ROOT

PINS = ROOT / "constraints.txt"
EXTRAS = (
    "test",
    "docs",
    "lint",
    "bench",
    "dask",
    "optuna",
    "ros2",
    "sign",
    "completion",
    "publish",
)


def needed(
    name: str, extras: frozenset[str], seen: set[tuple[str, frozenset[str]]]
) -> Iterator[str]:
    """Yield the names of the installed distributions that one distribution needs.

    These include the distribution itself and all indirect needs. `seen` collects the visited
    distributions.
    """
    if (name, extras) in seen:
        return
    seen.add((name, extras))
    try:
        result = distribution(name)
    except PackageNotFoundError:  # It belongs to an extra that is not installed.
        return
    yield name
    for text in result.requires or ():
        requirement = Requirement(text)
        expected = requirement.marker is None or any(
            requirement.marker.evaluate({"extra": e}) for e in ("", *extras)
        )
        if expected:
            yield from needed(
                canonicalize_name(requirement.name), frozenset(requirement.extras), seen
            )


def test_every_package_that_is_installed_has_a_version_in_the_tested_set() -> None:
    pins: set[str] = set()
    for line in PINS.read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            requirement = Requirement(line)
            name = canonicalize_name(requirement.name)
            if requirement.marker is None or requirement.marker.evaluate():
                assert name not in pins, f"{name} stands twice"
                pins.add(name)
    names = set(needed("ssm-planner", frozenset(EXTRAS), set())) - {"ssm-planner"}
    assert len(names) > 50
    assert not names - pins
