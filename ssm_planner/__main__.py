import sys

from ssm_planner.cli.main import main

sys.exit(main())
