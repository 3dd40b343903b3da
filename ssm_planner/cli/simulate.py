"""Run `ssm-planner simulate PLAN`, which simulates the exported set points with optional faults."""

from argparse import Namespace
from pathlib import Path

import ssm_planner as ssm
from ssm_planner.cli.shared import (
    FAILED,
    OK,
    fill_in_template,
    parse_option_quantity,
    print_result,
    progress_reporter,
    write_results,
)
from ssm_planner.errors import ProblemError
from ssm_planner.progress import Step
from ssm_planner.typing import Files, JsonObject


def run_simulate(options: Namespace) -> int:
    """Simulate how the arm executes a plan, and return the exit status.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command.

    Returns
    -------
    int
        Exit status: 0 if the simulated execution passed, and 1 otherwise.
    """
    progress = progress_reporter(f"reading {options.plan}")
    from ssm_planner.reporting import simulation_tables
    from ssm_planner.simulation.simulate import EVERYWHERE, simulate

    plan = ssm.load_plan(options.plan)
    controller = None if options.controller is None else ssm.load_controller(options.controller)
    result = simulate(plan, scenario_from_options(options), controller, progress)
    document: JsonObject = {"plan": options.plan, **result.to_dict()}
    stops = plan.stops if options.power_loss == EVERYWHERE else None
    if stops is not None:
        document["controlled_stops"] = {
            key: stops.to_dict()[key] for key in ("passed", "longest", "farthest")
        }

    def write(folder: Path) -> Files:
        """Write the page, the figures and the simulated recordings into a folder.

        The result contains the paths of the files by name.
        """
        from ssm_planner.reporting import write_simulation_figures, write_simulation_page
        from ssm_planner.simulation.recorder import write_recordings

        recordings = {
            f"recording_{joint}": path for joint, path in write_recordings(result, folder).items()
        }
        page = write_simulation_page(plan, result, folder / "simulation.html")
        return {"page": page, **recordings, **write_simulation_figures(result, folder)}

    document["files"] = write_results(options.output, "simulation", document, write)
    progress(Step("done"))
    lines = fill_in_template(
        "simulated.txt",
        result=result,
        tables=simulation_tables(result),
        draws=document["draws"],
        stops=document.get("controlled_stops"),
        files=document["files"],
    )
    print_result(options, document, lines)
    return OK if result.passed else FAILED


def scenario_from_options(options: Namespace) -> ssm.Scenario:
    """Build the scenario that the options of the command describe.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of the command `simulate`.

    Returns
    -------
    Scenario
        Speed, payload and faults of the simulated execution.

    Raises
    ------
    ProblemError
        If an option is invalid. The error names the option, its value and the allowed values.
    """
    from ssm_planner.problem import get_attributes
    from ssm_planner.simulation.simulate import DEFAULT_TIP_ERROR, EVERYWHERE

    payload = 0.0
    payload_time = 0.0
    if options.payload is not None:
        mass, separator, time = options.payload.partition("@")
        payload = parse_option_quantity("--payload", mass, "mass")
        payload_time = parse_option_quantity("--payload", time, "time") if separator else 0.0
    stall = None
    if options.stall is not None:
        joint, separator, time = options.stall.partition("@")
        if not separator:
            raise ProblemError(
                "invalid time",
                key="--stall",
                value=options.stall,
                allowed="JOINT@TIME, such as tilt@1s",
            )
        stall = (joint, parse_option_quantity("--stall", time, "time"))
    power_loss = options.power_loss
    if power_loss is not None and power_loss != EVERYWHERE:
        power_loss = parse_option_quantity("--power-loss", power_loss, "time")
    names = "speed instants supply friction draws spread dropped wrong_direction compliance travel"
    return ssm.Scenario(
        **get_attributes(options, names.split()),
        payload=payload,
        payload_time=payload_time,
        power_loss=power_loss,
        stall=stall,
        tip_error=DEFAULT_TIP_ERROR if options.tip_error is None else options.tip_error,
    )
