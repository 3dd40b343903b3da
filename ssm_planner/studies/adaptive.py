"""Searches that learn from what they have found: Optuna's TPE and NSGA-II, an optional extra.

Candidates are asked for in batches of one size and told in their order, so that the search is the same with any number of
workers, and after an interruption.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ssm_planner.errors import ProblemError
from ssm_planner.studies.store import Candidate
from ssm_planner.studies.study import Choice, Design, Study

BATCH = 16
POPULATION = 32
"""Of NSGA-II: two batches."""

Tell = Callable[[Sequence[Candidate]], None]


def batches(study: Study) -> Iterator[tuple[list[Design], Tell]]:
    """Batches of candidates, each with the function that takes their rows in order. Raises ProblemError without Optuna."""
    try:
        import optuna
    except ImportError:
        raise ProblemError(
            "needs the package optuna: pip install 'ssm_planner[optuna]'",
            file=study.file,
            key="search.method",
            value=study.search.method,
            allowed="sobol, grid",
        ) from None
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    search = study.search
    sampler: Any = (
        optuna.samplers.TPESampler(seed=search.seed, multivariate=True, constraints_func=_violation)
        if search.method == "tpe"
        else optuna.samplers.NSGAIISampler(
            seed=search.seed, population_size=POPULATION, constraints_func=_violation
        )
    )
    signs = [-1.0 if name.endswith("margin") else 1.0 for name in study.minimise]
    engine = optuna.create_study(directions=["minimize"] * len(signs), sampler=sampler)
    for start in range(0, search.points, BATCH):
        trials = [engine.ask() for _ in range(min(BATCH, search.points - start))]
        designs = [_design(study, trial) for trial in trials]

        def tell(rows: Sequence[Candidate], trials: Sequence[Any] = tuple(trials)) -> None:
            for trial, row in zip(trials, rows, strict=True):
                values: list[Any] = [row.figures.get(name) for name in study.minimise]
                good = row.state == "done" and None not in values
                trial.set_user_attr("falls_out", not good)
                # a candidate that falls out violates the constraint: its values only need to be finite
                told = (
                    [s * v for s, v in zip(signs, values, strict=True)]
                    if good
                    else [1e6] * len(signs)
                )
                engine.tell(trial, told)

        yield designs, tell


def _violation(trial: Any) -> tuple[float]:
    return (1.0 if trial.user_attrs.get("falls_out", False) else -1.0,)


def _design(study: Study, trial: Any) -> Design:
    chosen: dict[str, str] = {}
    for variable in study.vary:
        if isinstance(variable, Choice):
            chosen[variable.path] = trial.suggest_categorical(
                variable.path, list(variable.contents)
            )
        else:
            chosen[variable.path] = variable.at(trial.suggest_float(variable.path, 0.0, 1.0))
    return chosen
