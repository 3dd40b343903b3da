import sys

from ssm_planner.cli import main

sys.exit(main())
