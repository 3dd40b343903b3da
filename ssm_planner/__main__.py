"""Start the command line, as the command `ssm-planner` or by `python -m ssm_planner`."""

import os
import sys


def run() -> int:
    """Import the command line, run the command of this process, and return its exit status.

    An interruption during the import, before the command line handles signals, prints nothing.
    """
    try:
        from ssm_planner.cli import main
    except KeyboardInterrupt:
        return 130
    return main()


if __name__ == "__main__":
    # `python -m` adds the working directory to the module folders as the first. It is removed
    # unless it contains this package, so that no file of the user replaces a module.
    if sys.path and os.path.realpath(sys.path[0] or ".") != os.path.dirname(
        os.path.dirname(os.path.realpath(__file__))
    ):
        sys.path[:] = [
            entry for entry in sys.path if os.path.realpath(entry or ".") != os.path.realpath(".")
        ]
    sys.exit(run())
