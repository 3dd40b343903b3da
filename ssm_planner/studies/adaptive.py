"""Generate candidates by adaptive search with the package Optuna (TPE or NSGA-II).

The runner of a study requests candidates in batches of constant size, and reports their results in
the same order. Therefore, the candidates do not depend on the number of workers or on
interruptions.
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
"""Function that passes the results of a batch of candidates to the search."""


def candidate_batches(study: Study) -> Iterator[tuple[list[Design], ReportResults]]:
    """Yield batches of candidates that an adaptive search of Optuna proposes.

    A candidate is one of the robots that the study compares. The caller must report the results of
    a batch, in the order of its candidates, before it requests the next batch.

    Parameters
    ----------
    study : Study
        Study with its variables, its objectives and the method of its search, "tpe" or "nsga2".

    Yields
    ------
    designs : list of Design
        Designs of the candidates in the batch.
    report_results : callable
        Function that passes their results to the search.

    Raises
    ------
    ProblemError
        If the package Optuna is not installed.
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
    optuna_study = optuna.create_study(directions=["minimize"] * count, sampler=sampler)
    for start in range(0, search.points, BATCH_SIZE):
        trials = [optuna_study.ask() for _ in range(min(BATCH_SIZE, search.points - start))]
        designs = [_ask_for_design(study, trial) for trial in trials]

        def report_results(rows: Candidates, trials: Sequence[Any] = tuple(trials)) -> None:
            """Report the results of a batch to the search."""
            for trial, row in zip(trials, rows, strict=True):
                costs = row.costs(study.minimise)
                trial.set_user_attr("rejected", costs is None)
                # A rejected candidate violates the constraint. Its values only need to be finite.
                optuna_study.tell(trial, [1e6] * count if costs is None else costs)

        yield designs, report_results


def _constraint_value(trial: Any) -> tuple[float]:
    """Return the constraint of a trial for Optuna: 1 if the candidate was rejected, otherwise −1.

    Optuna regards a positive value as a violation.
    """
    is_rejected = trial.user_attrs.get("rejected", False)
    return (1.0,) if is_rejected else (-1.0,)


def _ask_for_design(study: Study, trial: Any) -> Design:
    """Ask Optuna for the value of each variable, and return the design of a trial.

    Parameters
    ----------
    study : Study
        Study with its variables.
    trial : optuna.Trial
        Trial, which is the object of Optuna for one candidate.

    Returns
    -------
    Design
        Value of each variable by its path.
    """
    design: dict[str, str] = {}
    for variable in study.vary:
        if isinstance(variable, Choice):
            design[variable.path] = trial.suggest_categorical(
                variable.path, list(variable.contents)
            )
        else:
            design[variable.path] = variable.value_at(trial.suggest_float(variable.path, 0.0, 1.0))
    return design
