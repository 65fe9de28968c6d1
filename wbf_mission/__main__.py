"""``python -m wbf_mission`` and the ``wbf-mission`` script."""

import sys


def main() -> None:
    """Run the command line and end the process with its exit code."""
    try:
        from wbf_mission.cli.app import main as run

        code = run()
    except KeyboardInterrupt:
        code = 130
    sys.exit(code)


if __name__ == "__main__":
    main()
