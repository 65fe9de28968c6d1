"""``python -m wbf_mission`` and the ``wbf-mission`` script."""

import sys


def main() -> None:
    """Run the command line and end the process with its exit code."""
    from wbf_mission.cli.app import main as run

    sys.exit(run())


if __name__ == "__main__":
    main()
