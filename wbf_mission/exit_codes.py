"""Exit codes of the command line.

======  =====================================================================================
0       done
1       done, but the outcome is not good; the result states the reason
2       bad input, or user code that failed; the cause is in one line on stderr; nothing was written
3       no vehicle was heard
4       the link dropped, or the vehicle stopped answering
5       the vehicle refused, or its mission differed from the uploaded one
70      a bug in the program
130     Ctrl-C
141     the reader of the output closed the pipe (``| head``)
143     SIGTERM
======  =====================================================================================
"""

from __future__ import annotations

from enum import IntEnum

from mission.outcome import Outcome


class ExitCode(IntEnum):
    """Exit code of a command; a code above 128 is 128 plus the number of a signal."""

    GOOD = 0
    NOT_GOOD = 1
    BAD_INPUT = 2
    NO_VEHICLE = 3
    LINK_LOST = 4
    REFUSED = 5
    PROGRAM_ERROR = 70
    INTERRUPTED = 130
    OUTPUT_CLOSED = 141
    TERMINATED = 143


def exit_code_of(error: Exception) -> ExitCode:
    """Return the exit code for an error that ended a command.

    Examples
    --------
    >>> from mission.errors import LinkLostError
    >>> exit_code_of(LinkLostError("tcp:127.0.0.1:5760: the other side closed the connection"))
    <ExitCode.LINK_LOST: 4>
    >>> exit_code_of(ValueError("a mistake of the caller"))
    <ExitCode.BAD_INPUT: 2>
    """
    from mission.errors import LinkLostError, NoPeerError, TransferError
    from mission.ground.command import VehicleRefusedError, VehicleSilentError
    from mission.ground.status_text import NotStartedError

    if isinstance(error, NotStartedError):
        return ExitCode.INTERRUPTED
    if isinstance(error, VehicleRefusedError):
        return ExitCode.REFUSED
    if isinstance(error, VehicleSilentError):
        return ExitCode.LINK_LOST
    if isinstance(error, NoPeerError):
        return ExitCode.NO_VEHICLE
    if isinstance(error, LinkLostError):
        return ExitCode.LINK_LOST
    return _of_transfer(error) if isinstance(error, TransferError) else ExitCode.BAD_INPUT


_OF_OUTCOMES = {
    Outcome.COMPLETED: ExitCode.GOOD,
    Outcome.INTERRUPTED: ExitCode.INTERRUPTED,
    Outcome.NO_CONTACT: ExitCode.NO_VEHICLE,
    Outcome.NO_ANSWER: ExitCode.LINK_LOST,
    Outcome.UPLOAD_FAILED: ExitCode.REFUSED,
    Outcome.ARMING_REFUSED: ExitCode.REFUSED,
    Outcome.MISSION_REJECTED: ExitCode.REFUSED,
}


def exit_code_of_flight(outcome: Outcome) -> ExitCode:
    """Return the exit code of a command by the outcome of its flight.

    Examples
    --------
    >>> exit_code_of_flight(Outcome.BATTERY_LOW)
    <ExitCode.NOT_GOOD: 1>
    """
    return _OF_OUTCOMES.get(outcome, ExitCode.NOT_GOOD)


def _of_transfer(error: Exception) -> ExitCode:
    from mission.transfer.events import FailureReason, NoVehicleError, RemoteTransferError

    if isinstance(error, NoVehicleError):
        return ExitCode.NO_VEHICLE
    if not isinstance(error, RemoteTransferError):
        return ExitCode.BAD_INPUT
    silent = error.failure is not None and error.failure.reason is FailureReason.TIMEOUT
    return ExitCode.LINK_LOST if silent else ExitCode.REFUSED
