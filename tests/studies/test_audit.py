"""An audit finds every changed row of the front, every damaged row and every missing row."""

from __future__ import annotations

import json
import random
import shutil
import sqlite3
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from ssm_planner.cli import main
from ssm_planner.errors import ProblemError
from ssm_planner.studies.audit import audit_study
from ssm_planner.studies.evaluation import Evaluation
from ssm_planner.studies.run import study as run_study
from ssm_planner.studies.study_file import load_study
from tests.studies.support import (
    FILE,
    closed_form,
    execute,
    figures_of,
    forge,
    study,
    without_planning,
)
from tests.support.once import made_once

__all__ = ["without_planning"]
FALSE_FIGURES = [1e9, -1.0, 0, True, None, "3.2", "nan", [], {}, [1.0], {"a": 1}, 10**400]
DAMAGES = {
    "state": ["failed", "fine", None, b"\xff", 3],
    "stage": ["reach", b"\xff\xfe", 7],
    "reason": ["none", b"\xff\xfe", 7],
    "design": ["{}", "[]", "", "no JSON", b"\xff", '{"geometry.alpha": "31 deg"}', "[" * 9000],
    "figures": ["{}", "[]", "", "no JSON", b"\xff\x00", '{"duration": NaN}', "[" * 9000],
    "sha256": ["", "0" * 64, b"\xff", 5],
}


@pytest.fixture
def folder(tmp_path: Path, without_planning: None) -> Path:
    """Run a study, write its file beside the results, and return the folder of the results."""
    run_study(study(), tmp_path / "out")
    text = json.dumps({**FILE, "robot": "vitreoretinal"})
    (tmp_path / "study.yaml").write_text(text, encoding="utf-8")
    return tmp_path / "out"


def statuses(folder: Path) -> list[int]:
    """Return the exit statuses of the four commands that read a store."""
    file = str(folder.parent / "study.yaml")
    return [
        main(["study", *words, "-o", str(folder)])
        for words in (
            [file],
            ["compare", "0", "1", file],
            ["show", "0", file],
            ["audit", str(folder)],
        )
    ]


def content(folder: Path) -> list[tuple[object, ...]]:
    """Return all rows of the store in a folder."""
    with closing(sqlite3.connect(folder / "study.sqlite")) as connection:
        connection.text_factory = bytes
        return connection.execute("SELECT * FROM candidates").fetchall()


def test_an_intact_study_passes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = audit_study(folder)
    front = {row.number for row in run_study(study(), folder).front}
    assert result.passed
    assert (result.faults, result.notes) == ((), ())
    assert {-1, *front} < set(result.planned)
    assert len(result.planned) == 1 + len(front) + -(-(16 - len(front)) // 20)
    assert main(["study", "audit", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["passed"] is True
    assert main(["study", "audit", str(folder)]) == 0
    assert "audit: PASSED" in capsys.readouterr().out


def test_the_random_rows_differ_between_audits(folder: Path) -> None:
    assert len({audit_study(folder).planned for _ in range(12)}) > 1


@pytest.mark.parametrize("factor", [1 + 1e-12, 1.001, 2.0, -1.0])
def test_a_forged_figure_of_the_front_is_found(folder: Path, factor: float) -> None:
    """A forged figure with a valid hash is found, because the audit plans the candidate again.

    Differences within the tolerance pass.
    """
    front = {row.number for row in run_study(study(), folder).front}
    number = random.choice(sorted(front))
    figures = figures_of(folder, number)
    changed = {**figures, "peak_torque": factor * figures["peak_torque"]}
    forge(folder, number, figures=json.dumps(changed, sort_keys=True, separators=(",", ":")))
    (folder / "table.csv").unlink()
    result = audit_study(folder)
    is_rounding = abs(factor - 1) < 1e-6
    assert result.passed == (is_rounding or number not in result.planned)
    if number in result.planned:
        pair = f"{changed['peak_torque']} is stored, {figures['peak_torque']} is planned again"
        texts = result.notes if is_rounding else result.faults
        assert texts == (f"candidate {number}: peak_torque: {pair}",)
    # A forged candidate may leave the front. Only a random part of the other candidates is planned.
    if number in {row.number for row in run_study(study(), folder).front}:
        assert number in result.planned
        assert not audit_study(folder, tolerance=0.0).passed
        assert audit_study(folder, tolerance=0.005).passed == (abs(factor - 1) < 0.005)
        assert main(["study", "audit", str(folder)]) == (not is_rounding)
        status = main(["study", "audit", str(folder), "--tolerance", "0.5%"])
        assert status == (abs(factor - 1) > 0.005)


@pytest.mark.parametrize("figure", FALSE_FIGURES)
@pytest.mark.parametrize("hashed", [True, False])
def test_a_false_figure_is_found_in_words(
    folder: Path, figure: object, hashed: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    text = json.dumps({**figures_of(folder, 0), "duration": figure})
    if hashed:
        forge(folder, 0, figures=text)
    else:
        execute(
            folder,
            "UPDATE candidates SET figures = ? WHERE key = (SELECT key FROM numbers WHERE number = 0)",
            text,
        )
    table = (folder / "table.csv").read_bytes()
    is_figure = figure is None or (isinstance(figure, (int, float)) and abs(figure) < 1e300)
    if hashed and is_figure:  # Only an audit detects a valid, changed number.
        assert not audit_study(folder).passed
        return
    compared = statuses(folder)
    assert compared == [2, 2, 2, 1]
    shown = capsys.readouterr()
    assert shown.err.count("the row of candidate 0 was changed") == 3
    assert "candidate 0: the row is missing or was changed" in shown.out
    assert (folder / "table.csv").read_bytes() == table


@pytest.mark.slow
@pytest.mark.parametrize("column", DAMAGES)
def test_every_damage_of_a_row_is_found_in_words(folder: Path, column: str) -> None:
    """Every damage is found, with and without a new hash of the row.

    The first row and the row of the study's robot are damaged.
    """
    copy = folder.with_name("copy")
    for number in (0, -1):
        for value in DAMAGES[column]:
            for hashed in (False, True):
                shutil.rmtree(copy, ignore_errors=True)
                shutil.copytree(folder, copy)
                row = "key = (SELECT key FROM numbers WHERE number = ?)"
                with suppress(sqlite3.IntegrityError):  # The database refuses NULL.
                    if hashed and column != "sha256":
                        forge(copy, number, **{column: value})
                    else:
                        execute(
                            copy, f"UPDATE candidates SET {column} = ? WHERE {row}", value, number
                        )
                if content(copy) == content(folder):
                    continue
                result = statuses(copy)
                assert set(result) <= {0, 1, 2}, (number, value, hashed, result)
                if not hashed:
                    assert result[0] == result[1] == result[2] == 2, (number, value, result)
                    assert result[3] == 1, (number, value, result)


def test_missing_added_and_exchanged_rows_are_found(folder: Path) -> None:
    copy = folder.with_name("copy")
    for statement in (
        "DELETE FROM candidates WHERE key = (SELECT key FROM numbers WHERE number = 5)",
        "DELETE FROM numbers WHERE number = 5",
        "DELETE FROM numbers WHERE number = -1",
        "INSERT INTO numbers SELECT 99, key FROM numbers WHERE number = 5",
        "UPDATE numbers SET key = (SELECT key FROM numbers WHERE number = 6) WHERE number = 5",
        "UPDATE study SET description = replace(description, '38.0', '39.0')",
    ):
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(folder, copy)
        execute(copy, statement)
        assert main(["study", "audit", str(copy)]) == (2 if "study" in statement else 1), statement
        assert not set(statuses(copy)) - {0, 1, 2}


def test_a_changed_table_is_found(folder: Path) -> None:
    table = folder / "table.csv"
    text = table.read_text(encoding="utf-8")
    table.write_text(text.replace("done", "done ", 1), encoding="utf-8")
    assert audit_study(folder).faults == ("table.csv does not contain the figures of the rows",)
    table.unlink()
    assert audit_study(folder).passed


def test_another_program_is_noted_and_its_figures_decide(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ssm_planner.studies.provenance.describe_program", lambda: {"numpy": "0.0"})
    monkeypatch.setattr("ssm_planner.studies.run.describe_program", lambda: {"numpy": "0.0"})
    monkeypatch.setattr("ssm_planner.studies.evaluation.describe_program", lambda: {"numpy": "0.0"})
    result = audit_study(folder)
    assert result.passed
    assert any("instead of 0.0" in note for note in result.notes)
    monkeypatch.setattr(Evaluation, "__call__", closed_form(2.0))
    assert not audit_study(folder).passed


def test_an_unfinished_study_does_not_pass(folder: Path) -> None:
    of = study()
    execute(folder, "DELETE FROM numbers WHERE number > 9")
    result = audit_study(folder)
    assert list(result.faults) == [
        f"candidate {number}: the row is missing or was changed" for number in range(10, of.count)
    ]


@pytest.mark.parametrize("tolerance", [-0.1, 1.5])
def test_an_impossible_tolerance_is_named(folder: Path, tolerance: float) -> None:
    with pytest.raises(ProblemError, match="tolerance"):
        audit_study(folder, tolerance=tolerance)


def test_a_folder_without_a_study_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ProblemError, match="does not contain the results of a study"):
        audit_study(tmp_path)
    assert main(["study", "audit", str(tmp_path)]) == 2
    assert main(["study", "audit"]) == 2
    assert main(["study", "audit", str(tmp_path), "more"]) == 2


@pytest.mark.slow
def test_planned_studies_pass_and_their_forged_fronts_do_not(
    tmp_path_factory: pytest.TempPathFactory, tmp_path: Path
) -> None:
    """A study with selected motors and two motions passes the audit.

    The same study with a forged duration in its front fails.
    """
    of = load_study("vitreoretinal")
    of = replace(of, search=replace(of.search, points=6))
    out = made_once(tmp_path_factory, "audited", partial(run_study, of, workers=1))
    result = audit_study(out, workers=1)
    assert result.passed, result
    shutil.copytree(out, tmp_path / "forged")
    row = run_study(of, tmp_path / "forged", workers=1).front[0]
    forge(tmp_path / "forged", row.number, figures=json.dumps({**row.figures, "duration": 1.0}))
    words = f"duration: 1.0 is stored, {row.figures['duration']} is planned again"
    assert audit_study(tmp_path / "forged", workers=1).faults == (
        "table.csv does not contain the figures of the rows",
        f"candidate {row.number}: {words}",
    )
