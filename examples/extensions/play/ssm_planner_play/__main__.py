"""Entry point of the command `ssm-planner-play`."""

from __future__ import annotations

import sys

INTERRUPTED = 130
"""Exit status after Ctrl-C outside the motion."""


def main() -> int:
    """Run the command. Ctrl-C outside the motion ends it with one line."""
    try:
        from ssm_planner_play.cli import main as run

        return run()
    except KeyboardInterrupt:
        print("interrupted: no drive is enabled", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
