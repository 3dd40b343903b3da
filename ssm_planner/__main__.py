import os
import sys

# `python -m` adds the working directory to the module folders as the first. It is removed unless it
# contains this package, so that no file of the user replaces a module.
if sys.path and os.path.realpath(sys.path[0] or ".") != os.path.dirname(
    os.path.dirname(os.path.realpath(__file__))
):
    sys.path[:] = [
        entry for entry in sys.path if os.path.realpath(entry or ".") != os.path.realpath(".")
    ]

try:
    from ssm_planner.cli import main
except KeyboardInterrupt:  # an interruption before the command line handles it
    sys.exit(130)

sys.exit(main())
