"""Output for terminals shows verdicts, suggestions for mistyped words, and colours.

No line is wider than the terminal, and colours appear only on terminals.
"""

from __future__ import annotations

import io
import json
import os
import random
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.atomic import output_file
from ssm_planner.cli import COMMANDS, _build_parser, _protect_negative_value, main
from ssm_planner.cli.shared import progress_reporter
from ssm_planner.cli.terminal import print_lines, shorten, wrap_line
from ssm_planner.display import format_number, terminal_width
from ssm_planner.plans import load_plan
from ssm_planner.progress import Step
from ssm_planner.reporting.text import (
    ACTIVE_MARGIN,
    Table,
    answer_lines,
    closest_inactive_limit,
    summary_lines,
    unit_of_limit,
)
from ssm_planner.studies.run import StudyResult
from ssm_planner.studies.store import Candidate
from ssm_planner.studies.study_file import load_study
from tests.support.cases import selected
from tests.support.executions import COUNTS, Executions, write
from tests.support.paths import ROOT

PLAN = str(ROOT / "results/tilt_insert")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_bare_command_lists_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    said = capsys.readouterr().err
    assert all(re.search(rf"^ +{name}\b", said, re.M) for name in COMMANDS)


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["plna", "x"], "'plan'"),
        (["simluate"], "'simulate'"),
        (["check", PLAN, "--robto", "x"], "'--robot'"),
    ],
)
def test_a_misspelt_word_gets_a_suggestion(
    words: list[str], meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert f"did you mean {meant}?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "key"),
    [
        (["plan", "nothing.yaml", "--json"], "nothing.yaml"),
        (["check", "--json"], "required"),
        (["nonsense", "--json"], "unknown command"),
        (["ik", "vitreoretinal", "--tilt", "-100", "--json"], "unit"),
    ],
)
def test_json_is_printed_for_bad_input_too(
    words: list[str], key: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    captured = capsys.readouterr()
    error = json.loads(captured.out)["error"]
    assert key in error["message"]
    assert {"file", "line", "key", "value", "allowed"} < set(error)
    assert error["message"] in captured.err


def test_a_wrong_file_is_named_as_what_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plan", "problems/robots/vitreoretinal.yaml"]) == 2
    assert "a robot file instead of a problem file" in capsys.readouterr().err
    assert main(["check", str(tmp_path / "nothing")]) == 2
    assert "no such file or folder" in capsys.readouterr().err


@pytest.mark.slow
def test_the_json_of_a_fault_states_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    assert main(["new", "problem", str(file)]) == 0
    capsys.readouterr()
    file.write_text(
        file.read_text(encoding="utf-8").replace("to: 20 mm", "to: 20"), encoding="utf-8"
    )
    assert main(["plan", str(file), "--json"]) == 2
    error = json.loads(capsys.readouterr().out)["error"]
    line = next(
        i
        for i, text in enumerate(file.read_text(encoding="utf-8").splitlines(), 1)
        if "to: 20" in text
    )
    assert (error["file"], error["line"], error["value"]) == (str(file), line, "20")


@pytest.mark.parametrize("width", [60, 80, 100])
@pytest.mark.parametrize("command", [["check", PLAN], ["size", PLAN, "--what-if"]])
@pytest.mark.slow
def test_nothing_is_wider_than_the_terminal(
    command: list[str],
    width: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    assert main(command) in (0, 1)
    wide = [line for line in capsys.readouterr().out.splitlines() if len(line) > max(width, 72)]
    assert not wide


def test_every_help_fits(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    for name in COMMANDS:
        with pytest.raises(SystemExit):
            main([name, "--help"])
        said = capsys.readouterr().out
        assert max(map(len, said.splitlines())) <= 100, name
        words = shlex.split(said.partition("Example: ssm-planner ")[2])
        example = [_protect_negative_value(word) for word in words]
        assert _build_parser(example).parse_args(example).run.__name__ == f"run_{name}"


def test_a_path_with_spaces_is_never_broken() -> None:
    line = f"file     /{'a long folder/' * 12}report.html"
    assert wrap_line(line, 80) == [line]


@pytest.mark.parametrize("problem", ["tilt_insert", "eye_approach"])
def test_a_plan_ends_with_its_answers_on_one_screen(
    problem: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    folder = ROOT / "results" / problem
    plan = load_plan(folder)
    file = f"file     {folder / 'report.html'}"  # as the command `plan` appends it
    short = shorten([*summary_lines(plan), file])
    assert len(short) <= 25
    assert max(map(len, short[:-1])) <= 80, "a path is one word"
    assert [line.split()[0] for line in short[-5:]] == [
        "time",
        "check",
        "closest",
        "motors",
        "file",
    ]
    assert short[-1] == file
    assert plan.certificate is not None
    closest = closest_inactive_limit(plan.certificate.limits)
    assert closest is not None
    assert f"closest  {closest.name}" in short[-3]
    unit, scale = unit_of_limit(closest)
    spare = format_number(scale * abs(closest.worst - closest.limit))
    assert short[-3].endswith(f", {spare} {unit} to spare")
    beyond = [item for item in plan.certificate.limits if item.margin < closest.margin]
    assert all(item.margin <= ACTIVE_MARGIN for item in beyond)
    everything = summary_lines(plan, verbose=True)
    assert everything[-4:] == [*answer_lines(plan)]
    assert any(line.startswith("limit ") for line in everything)


@given(st.lists(st.text("ab ", max_size=200), max_size=60))
def test_a_short_text_keeps_its_end(lines: list[str]) -> None:
    whole = [part for line in lines for part in wrap_line(line, terminal_width())]
    short = shorten(lines)
    assert len(short) <= 25
    assert short[-6:] == whole[-6:]
    assert short == whole or "-v" in short[-7]


def test_words_stay_whole_and_under_their_label() -> None:
    assert wrap_line("check        PASSED: 43 limits at 45668 instants", 30) == [
        "check        PASSED: 43 limits",
        "             at 45668 instants",
    ]
    assert wrap_line("note: one two three", 12) == ["note: one", "  two three"]
    assert wrap_line("file: " + "x" * 40, 20) == ["file:", "  " + "x" * 40], "a path is one word"
    assert " ".join("".join(wrap_line("a b  c d", 4)).split()) == "a b c d"


def test_a_table_gets_narrower_by_wrapping_text_never_numbers() -> None:
    table = Table(
        ("joint", "motor", "peak torque mN·m"),
        [("roll", "maxon ECX TORQUE 22 XL", "30.33 of 78")],
        (2,),
    )
    assert max(map(len, table.lines(100))) == 47
    lines = table.lines(36)
    assert max(map(len, lines)) <= 36
    assert "30.33 of 78" in "\n".join(lines)
    assert " ".join(" ".join(lines).split()).count("ECX") == 1


def test_colours_on_a_terminal_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    plain, coloured, refused = io.StringIO(), Terminal(), Terminal()
    for stream in (plain, coloured):
        monkeypatch.setattr("sys.stdout", stream)
        print_lines(["check: PASSED", "motor BEYOND", "nothing"])
    assert plain.getvalue() == "check: PASSED\nmotor BEYOND\nnothing\n"
    assert (
        coloured.getvalue()
        == "check: \x1b[32mPASSED\x1b[0m\nmotor \x1b[31mBEYOND\x1b[0m\nnothing\n"
    )
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr("sys.stdout", refused)
    print_lines(["check: PASSED"])
    assert refused.getvalue() == "check: PASSED\n"


CATALOGUE = str(ROOT / "problems/catalogues/motors_24v.csv")
RIG = str(ROOT / "problems/drives/rig1_lead_screw.yaml")
STUDY = str(ROOT / "problems/studies/vitreoretinal.yaml")
RECORDED = ("roll.csv", "tilt.csv", "insertion.csv")
LAST = {
    "check": (["check", PLAN], r"check: PASSED: \d+ limits kept"),
    "check faster": (["check", PLAN, "--speed", "1%..100%"], r"check: PASSED: \d+ limits kept"),
    "check wrong": (
        ["check", PLAN, "--tip-speed", "1 mm/s"],
        r"check: FAILED: \d+ of \d+ limits exceeded",
    ),
    "size": (["size", PLAN, "--what-if"], r"Motors suffice with [\d.]+ % margin"),
    "select": (["size", PLAN, "--catalogue", CATALOGUE], "every joint has a suitable motor: not"),
    "simulate": (["simulate", PLAN], "(NOT )?PASSED"),
    "compare": (
        ["compare", PLAN, *RECORDED, "--counts-per-turn", str(COUNTS)],
        "margins: held in reality",
    ),
    "identify": (
        ["identify", RIG, "--law", "coulomb", "-o", "out"],
        "friction law coulomb, map NRMSD",
    ),
    "study": (["study", STUDY, "-o", "out"], "vitreoretinal: 40 candidates: .* on the front"),
}
"""Commands with the text of their verdicts. Another test covers the command `plan`."""


@pytest.mark.parametrize("name", LAST)
@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
def test_every_command_ends_with_its_verdict(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The verdict is in the last 24 lines at any width, on a terminal and in a pipe.

    The command `check` and a run with EVERY_CASE=1 combine both widths with both kinds of output.
    Other commands are tested with two of the four combinations.
    """
    words, verdict = LAST[name]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    if name == "compare":
        it = Executions(load_plan(PLAN))
        write(it, it.healthy(1), tmp_path)
    of, draw = load_study(STUDY), random.Random(1)
    rows = [
        Candidate(
            k,
            "done",
            of.design(np.array([draw.random() for _ in of.paths])),
            figures=dict.fromkeys(of.minimise, 0.1),
        )
        for k in range(40)
    ]
    result = StudyResult(of, tuple(rows), tmp_path, finished=True, own=rows[0])
    monkeypatch.setattr("ssm_planner.studies.run.study", lambda *_: result)
    (tmp_path / "out").mkdir()
    every = [(width, kind) for width in ("80", "120") for kind in (io.StringIO, Terminal)]
    for width, kind in every if name == "check" else selected(every[::3], every=every):
        stream = kind()
        monkeypatch.setenv("COLUMNS", width)
        monkeypatch.setattr(sys, "stdout", stream)
        assert main(words) in (0, 1)
        plain = re.sub(r"\x1b\[\d+m", "", stream.getvalue())
        assert any(re.match(verdict, line) for line in plain.splitlines()[-24:]), plain[-2000:]


def test_the_verdict_is_the_last_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", PLAN]) == 0
    assert re.search(r"\ncheck: PASSED: \d+ limits kept\n$", capsys.readouterr().out)


def test_a_sampled_table_names_what_to_export_instead(capsys: pytest.CaptureFixture[str]) -> None:
    table = f"{PLAN}/trajectory.csv"
    assert main(["check", table]) == 2
    assert f"export {PLAN} --to csv" in capsys.readouterr().err
    main(["check", table, "--robot", "vitreoretinal"])
    out = " ".join(capsys.readouterr().out.split())
    assert f"export {PLAN} --to csv" in out
    assert f"check {PLAN}" in out


def test_o_is_a_folder_and_a_file_by_its_ending(tmp_path: Path) -> None:
    default = Path("results/rig/rig.yaml")
    assert output_file(None, ".yaml", default) == default
    assert output_file(tmp_path, ".yaml", default) == tmp_path / "rig.yaml"
    assert output_file(tmp_path / "new", ".yaml", default) == tmp_path / "new/rig.yaml"
    assert output_file(tmp_path / "mine.yaml", ".yaml", default) == tmp_path / "mine.yaml"


def test_counted_steps_say_the_time_left(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr("ssm_planner.cli.shared.time.perf_counter", lambda: now[0])
    report = progress_reporter()
    for k in range(60):
        report(Step("scan", k, 60))
        now[0] += 0.5
    report(Step("done"))
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) < 40, "not every step"
    assert any("(31 of 60), about 15 s left" in line for line in lines), lines
    assert lines[-1].endswith("done")


def test_a_shell_completes_commands_and_options(tmp_path: Path) -> None:
    pytest.importorskip("argcomplete")

    def completed(line: str) -> set[str]:
        result = tmp_path / "found"
        environment = {
            **os.environ,
            **{
                "_ARGCOMPLETE": "1",
                "_ARGCOMPLETE_IFS": "\n",
                "_ARGCOMPLETE_STDOUT_FILENAME": str(result),
            },
            **{
                "COMP_LINE": line,
                "COMP_POINT": str(len(line)),
                "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
            },
        }
        subprocess.run(
            [sys.executable, "-c", "from ssm_planner.cli import main; main()"],
            env=environment,
            check=True,
        )
        return {word.strip() for word in result.read_text(encoding="utf-8").split("\n")}

    assert completed("ssm-planner si") == {"simulate", "size"}
    assert "--power-loss" in completed("ssm-planner simulate x --")
    assert {"robot", "drive"} <= completed("ssm-planner new ")


def test_identified_parameters_have_their_units(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = str(ROOT / "problems/drives/rig1_lead_screw.yaml")
    assert main(["identify", drive, "--law", "coulomb", "-o", str(tmp_path)]) == 0
    said = capsys.readouterr()
    rows = {
        line.split()[0]: line.split()[4]
        for line in said.out.splitlines()
        if re.match(r"(b_|load_off)\w+ ", line)
    }
    assert rows == {
        "b_c": "N·m",
        "b_v": "N·m·s/rad",
        "b_oc": "N",
        "load_offset": "N",
        "b_ov": "N·s/m",
    }
    assert "coulomb law (1 of 5)" in said.err
