"""Exit codes of the command line."""

from __future__ import annotations

from enum import IntEnum

from mission.outcome import Outcome


class ExitCode(IntEnum):
    """Exit code of a command; a code above 128 is 128 plus the number of a signal."""

    GOOD = 0
    NOT_GOOD = 1  # The command ended, but the outcome is not good; the result states the reason.
    BAD_INPUT = 2  # Wrong input or failed user code; nothing was written, and stderr states the cause.
    NO_VEHICLE = 3  # No vehicle was heard.
    LINK_LOST = 4  # The link dropped, or the vehicle stopped answering.
    REFUSED = 5  # The vehicle refused, or its mission differed from the uploaded one.
    PROGRAM_ERROR = 70  # A bug in the program.
    INTERRUPTED = 130  # Ctrl-C.
    OUTPUT_CLOSED = 141  # The reader of the output closed the pipe (``| head``).
    TERMINATED = 143  # SIGTERM.


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
    """Return the exit code of a command whose flight had this outcome.

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
