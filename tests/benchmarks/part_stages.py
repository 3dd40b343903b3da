"""Compare three ways to evaluate an element model over the mesh: mapped, unrolled and compiled.

A mapped function is interpreted once per element. An unrolled one is a single expression of the
whole mesh.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any
from unittest.mock import patch

import casadi as ca
import numpy as np

from ssm_planner.elements.element import element_functions
from ssm_planner.planning.ocp.transcription import Transcription
from ssm_planner.planning.planner import plan_motion
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked_copy
from tests.benchmarks.cases import FREE_WEAK, Change, free_problem, straight_problem
from tests.benchmarks.measuring import Spread, in_turns, short, timed
from tests.benchmarks.section import Section

REPEATS = 10


def run(quick: bool) -> Section:
    section = Section("Stages: mapped, unrolled, compiled")
    section.say(
        "Jacobian and Hessian of the limits over one mesh, as Ipopt asks for them in every iteration. *Mapped*: one "
        "element's function in CasADi's virtual machine, once per element. *Unrolled*: the whole mesh as one expression. "
        "*Compiled*: one element's function in C (gcc -O1), mapped. *Build* comes once per structure."
    )
    compiler = shutil.which("gcc")
    if compiler is None:
        section.cannot.append(("compiled", "no gcc on this machine"))
    cases = {"straight": straight_problem(Change(), FREE_WEAK)}
    if not quick:
        cases["free"] = free_problem(Change(), FREE_WEAK)
    rows = []
    for name, problem in cases.items():
        rows += _ways(name, problem, compiler, 1 if quick else 5)
    section.table(
        ("stage", "way", "instructions of one element", "build", "one evaluation", "÷ mapped"), rows
    )
    return section


def _ways(name: str, problem: Problem, compiler: str | None, rounds: int) -> list[list[str]]:
    programs: list[Transcription] = []
    solve = Transcription.solve
    with patch.object(
        Transcription, "solve", lambda self, *given: programs.append(self) or solve(self, *given)
    ):
        plan_motion(unchecked_copy(problem, planner="ipopt"))
    largest = max(programs, key=lambda built: len(built.element.row_names))
    count = largest.structure.elements
    build, element = timed(lambda: element_functions(largest.element))
    functions = (element.jacobian, element.hessian)
    rng = np.random.default_rng(1)
    arguments = [
        [ca.DM(rng.uniform(0.1, 1.0, (f.size1_in(i), count))) for i in range(f.n_in())]
        for f in functions
    ]
    builds, ways = (
        {"mapped": build},
        {"mapped": _calls([f.map(count) for f in functions], arguments)},
    )
    seconds, unrolled = timed(lambda: [f.map(count, "unroll").expand() for f in functions])
    builds["unrolled"], ways["unrolled"] = build + seconds, _calls(unrolled, arguments)
    with tempfile.TemporaryDirectory() as folder:
        if compiler is not None:
            seconds, compiled = timed(lambda: _compiled(functions, compiler, Path(folder)))
            builds["compiled"] = build + seconds
            ways["compiled"] = _calls([f.map(count) for f in compiled], arguments)
            for mine, other in zip(functions, compiled, strict=True):
                first = [argument[:, 0] for argument in arguments[functions.index(mine)]]
                assert float(ca.norm_inf(ca.vec(mine(*first) - other(*first)))) == 0.0
        times, _ = in_turns(ways, rounds)
    size = str(sum(f.expand().n_instructions() for f in functions))
    return [
        [
            name,
            way,
            size,
            f"{short(builds[way])} s",
            Spread.of([seconds / REPEATS for seconds in spread.values]).seconds(),
            spread.over(times["mapped"]).text(),
        ]
        for way, spread in times.items()
    ]


def _calls(functions: Any, arguments: list[list[ca.DM]]) -> Any:
    def call(_: int) -> None:
        for _ in range(REPEATS):
            for function, inputs in zip(functions, arguments, strict=True):
                function(*inputs)

    return call


def _compiled(functions: tuple[ca.Function, ...], compiler: str, folder: Path) -> list[ca.Function]:
    generator = ca.CodeGenerator("stage.c")
    for function in functions:
        generator.add(function)
    generator.generate(f"{folder}/")
    library = folder / "stage.so"
    flags = ("-O1", "-ffp-contract=off", "-shared", "-fPIC")
    subprocess.run([compiler, *flags, "-o", str(library), str(folder / "stage.c")], check=True)
    return [ca.external(function.name(), str(library)) for function in functions]
