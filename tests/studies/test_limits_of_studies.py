"""Studies that would not fit into memory are refused, and results are not written through links."""

from __future__ import annotations

import json
import tracemalloc
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import qmc

from ssm_planner.cli import main
from ssm_planner.errors import ExportError, ProblemError
from ssm_planner.studies.run import study as run_study
from ssm_planner.studies.store import Store
from ssm_planner.studies.study import Search, Varied, sobol_points
from tests.studies.support import FILE, execute, study, without_planning

__all__ = ["without_planning"]
LARGE = [
    ("grid", 10_000, 3, "1e+12 candidates"),
    ("grid", 3163, 2, "1.00046e+07 candidates"),
    ("grid", 2, 24, "1.67772e+07 candidates"),
    ("sobol", 10**9, 2, "1e+09 candidates"),
    ("sobol", 10**7 + 1, 2, "1e+07 candidates"),
    ("sobol", 0, 2, "0 candidates"),
    ("grid", -3, 3, "-27 candidates"),
    ("tpe", 10**8, 1, "1e+08 candidates"),
]


@pytest.mark.parametrize(("method", "points", "spans", "words"), LARGE)
def test_too_many_candidates_are_refused_before_anything_is_allocated(
    method: str, points: int, spans: int, words: str
) -> None:
    of = study()
    vary = tuple(Varied(f"geometry.a{k}", 1.0, 2.0, "deg") for k in range(spans))
    tracemalloc.start()
    with pytest.raises(ProblemError, match=r"search\.points") as caught:
        replace(of, vary=vary, search=Search(method, points))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert words in str(caught.value)
    assert "1 to 10000000" in str(caught.value)
    assert peak < 1e6


@pytest.mark.parametrize(
    ("search", "words"),
    [
        (
            {"method": "grid", "points": 10_000},
            "the grid search has 1e+08 candidates (allowed: 1 to 10000000 candidates)",
        ),
        ({"method": "sobol", "points": 10_000_001}, "points"),
        ({"method": "tpe", "points": 10**12}, "points"),
    ],
)
def test_a_file_with_too_many_candidates_is_named(
    search: dict[str, object], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "study.yaml"
    file.write_text(json.dumps({**FILE, "search": search}), encoding="utf-8")
    assert main(["study", str(file), "-o", str(tmp_path / "out")]) == 2
    error = " ".join(capsys.readouterr().err.split())
    assert "study.yaml" in error
    assert words in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("method", ["grid", "sobol"])
def test_candidates_are_generated_when_they_are_needed(method: str) -> None:
    """The first two of 10⁷ Sobol designs or 9·10⁶ grid designs take less than 3 MB of memory."""
    of = study()
    large = replace(of, search=Search(method, 10_000_000 if method == "sobol" else 3000))
    first = list(islice(large.designs(), 2))  # The first call also loads libraries.
    tracemalloc.start()
    assert list(islice(large.designs(), 2)) == first
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3e6


@pytest.mark.parametrize("dimensions", [1, 3, 20])
@pytest.mark.parametrize("points", [1, 5, 4096, 4097, 10_000])
def test_the_points_are_those_of_the_whole_sequence(dimensions: int, points: int) -> None:
    complete = qmc.Sobol(dimensions, scramble=True, seed=7).random_base2(14)
    drawn = np.array(list(sobol_points(dimensions, points, 7)))
    assert np.array_equal(drawn, complete[:points])


def test_the_number_of_candidates_is_that_of_the_designs() -> None:
    of = study(vary={**FILE["vary"], "joints.roll.drive.friction.mu": {"choices": [0.1, 0.2]}})
    for search in (Search("sobol", 13), Search("grid", 3), Search("grid", 1)):
        item = replace(of, search=search)
        assert item.count == sum(1 for _ in item.designs())


NAMES = [
    *("study.sqlite", "study.sqlite-wal", "study.sqlite-shm", "study.lock", "study.html"),
    *("table.csv", "front.png", "front.pdf", "map.png", "map.pdf"),
]


@pytest.mark.usefixtures("without_planning")
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("exists", [True, False])
@pytest.mark.parametrize("resumed", [True, False])
def test_results_are_not_written_through_links(
    tmp_path: Path, name: str, exists: bool, resumed: bool
) -> None:
    folder, target = tmp_path / "out", tmp_path / "elsewhere"
    folder.mkdir()
    if resumed:
        run_study(study(), folder)
    if exists:
        target.write_text("precious", encoding="utf-8")
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(target)
    before = sorted(path.name for path in folder.iterdir())
    with pytest.raises(ExportError, match=rf"{name}: .*symbolic link"):
        run_study(study(), folder)
    assert target.exists() == exists
    assert not exists or target.read_text(encoding="utf-8") == "precious"
    assert sorted(path.name for path in folder.iterdir()) == before
    (folder / name).unlink()
    if name not in ("study.sqlite-wal", "study.sqlite-shm"):
        assert run_study(study(), folder).finished


@pytest.mark.usefixtures("without_planning")
def test_a_folder_may_be_a_link(tmp_path: Path) -> None:
    (tmp_path / "large_disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "large_disk")
    run_study(study(), tmp_path / "out")
    assert (tmp_path / "large_disk" / "table.csv").is_file()


@pytest.mark.usefixtures("without_planning")
def test_pages_of_a_candidate_are_not_written_through_links(tmp_path: Path) -> None:
    from ssm_planner.studies.show import write_candidate

    folder, target = tmp_path / "out", tmp_path / "elsewhere"
    run_study(study(), folder)
    target.mkdir()
    (folder / "candidate_0").symlink_to(target)
    with pytest.raises(ExportError, match=r"candidate_0: .*symbolic link"):
        write_candidate(study(), folder, 0)
    assert list(target.iterdir()) == []
    (folder / "candidate_0").unlink()
    (folder / "candidate_0").mkdir()
    (folder / "candidate_0" / "robot.yaml").symlink_to(target / "robot.yaml")
    with pytest.raises(ExportError, match=r"robot\.yaml: .*symbolic link"):
        write_candidate(study(), folder, 0)
    assert list(target.iterdir()) == []


def test_a_store_of_an_earlier_version_is_refused_and_not_changed(tmp_path: Path) -> None:
    with Store(tmp_path / "study.sqlite"):
        pass
    execute(tmp_path, "PRAGMA user_version = 1")
    with pytest.raises(
        ProblemError, match=r"another version of the program .*choose another folder"
    ):
        Store(tmp_path / "study.sqlite")
