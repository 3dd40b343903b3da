"""Generate candidates by adaptive search. The methods are TPE and NSGA-II of the package Optuna.

Candidates are requested in batches of constant size, and their results are reported in the same
order. Therefore, the search does not depend on the number of workers or on interruptions.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ssm_planner.errors import ProblemError
from ssm_planner.studies.store import Candidates
from ssm_planner.studies.study import Choice, Design, Study
from ssm_planner.typing import Keywords

BATCH_SIZE = 16
"""Number of candidates in a batch."""
POPULATION_SIZE = 32
"""Population size of NSGA-II, which equals two batches."""

ReportResults = Callable[[Candidates], None]
"""Function that reports the results of a batch to the search."""


def candidate_batches(study: Study) -> Iterator[tuple[list[Design], ReportResults]]:
    """Yield batches of candidates, each with a function that reports their results.

    The caller must report the results of a batch, in the order of its candidates, before it
    requests the next batch. Raises ProblemError if Optuna is not installed.
    """
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
    options: Keywords = {"seed": search.seed, "constraints_func": _constraint_value}
    sampler: Any
    if search.method == "tpe":
        sampler = optuna.samplers.TPESampler(multivariate=True, **options)
    else:
        sampler = optuna.samplers.NSGAIISampler(population_size=POPULATION_SIZE, **options)
    count = len(study.minimise)
    engine = optuna.create_study(directions=["minimize"] * count, sampler=sampler)
    for start in range(0, search.points, BATCH_SIZE):
        trials = [engine.ask() for _ in range(min(BATCH_SIZE, search.points - start))]
        designs = [_ask_for_design(study, trial) for trial in trials]

        def tell(rows: Candidates, trials: Sequence[Any] = tuple(trials)) -> None:
            """Report the results of a batch to the search."""
            for trial, row in zip(trials, rows, strict=True):
                costs = row.costs(study.minimise)
                trial.set_user_attr("rejected", costs is None)
                # A rejected candidate violates the constraint. Its values only need to be finite.
                engine.tell(trial, [1e6] * count if costs is None else costs)

        yield designs, tell


def _constraint_value(trial: Any) -> tuple[float]:
    """Return the constraint of a trial, which is positive if the candidate was rejected."""
    is_rejected = trial.user_attrs.get("rejected", False)
    return (1.0,) if is_rejected else (-1.0,)


def _ask_for_design(study: Study, trial: Any) -> Design:
    """Request the design of one trial from Optuna."""
    design: dict[str, str] = {}
    for variable in study.vary:
        if isinstance(variable, Choice):
            design[variable.path] = trial.suggest_categorical(
                variable.path, list(variable.contents)
            )
        else:
            design[variable.path] = variable.value_at(trial.suggest_float(variable.path, 0.0, 1.0))
    return design
