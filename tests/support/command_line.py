"""The command line in the process of the tests."""

from wbf_mission.cli.app import main


def run(capsys, *words):
    """Return the exit code, and what was written to stdout and stderr."""
    code = main(list(words))
    out, err = capsys.readouterr()
    return code, out, err


def ran(capsys, *words, code=0):
    """Return what was written by a command that must end with this exit code: ``out`` and ``err``."""
    assert main(list(words)) == code
    return capsys.readouterr()
