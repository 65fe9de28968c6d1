"""Errors of planning, mission items, mission files, mission transfer and links."""

from geo.errors import WbfMissionError


class PlanningError(WbfMissionError, ValueError):
    """A planning request that is invalid or has no solution."""


class AnswerError(PlanningError):
    """A policy's answer that cannot be flown.

    Parameters
    ----------
    kind : str
        Short name of the fault, for statistics.
    """

    def __init__(self, text: str, kind: str) -> None:
        super().__init__(text, kind)
        self.kind = kind

    def __str__(self) -> str:
        return str(self.args[0])


class MissionError(WbfMissionError, ValueError):
    """A mission item or mission with values that cannot be flown or sent."""


class MissionFileError(WbfMissionError, ValueError):
    """A mission file that cannot be read or written."""


class TransferError(WbfMissionError, RuntimeError):
    """A mission upload, download or clear that failed."""


class LinkError(WbfMissionError, OSError):
    """A link that cannot be opened or that broke."""


class NoPeerError(LinkError):
    """A link whose other end does not answer."""


class LinkLostError(LinkError):
    """A link that broke after it was opened."""
