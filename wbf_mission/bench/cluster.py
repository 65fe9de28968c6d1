"""Workers of Dask, on this machine or on others."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from typing import Any, TypeVar

from geo.errors import WbfMissionError
from geo.texts import one_line

__all__ = ["Cluster", "ClusterError"]

LOCAL = "local"
_T = TypeVar("_T")
_WAIT_S = 60.0


class ClusterError(WbfMissionError):
    """A Dask cluster that is not there, is not fit or is lost."""


class Cluster:
    """The workers of a Dask scheduler.

    Parameters
    ----------
    address : str
        Of the scheduler; ``local``: one is started here, on the loopback interface, and ends with this.
    workers : int
        How many of a local one.

    Attributes
    ----------
    most : int
        How many runs it is given at a time.

    Raises
    ------
    ClusterError
        If the package is not installed, the scheduler does not answer, has no workers, or has such with
        several threads: a run counts on the process for itself.
    """

    def __init__(self, address: str, workers: int) -> None:
        try:
            from distributed import Client, LocalCluster
        except ImportError:
            msg = "--dask needs Dask: install it with pip install 'wbf-mission[dask]'"
            raise ClusterError(msg) from None
        self._local: Any = None
        self._address = address
        if address == LOCAL:
            self._local = LocalCluster(
                n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
            )
        try:
            self._client = Client(self._local or address, set_as_default=False)
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            why = one_line(str(error)) or "no answer"
            msg = f"--dask {address}: no scheduler answers there ({why})"
            raise ClusterError(msg) from None
        try:
            self.most = 2 * self._require_workers()
            self._executor = self._client.get_executor(pure=False)
        except BaseException:
            self.close()
            raise

    def submit(self, function: Callable[..., _T], /, *arguments: Any) -> Future[_T]:
        """Have a call made; what is called is sent by its name."""
        future: Future[_T] = self._executor.submit(function, *arguments)
        return future

    def result(self, future: Future[_T]) -> _T | None:
        """Return what a future that is done gave; None if worker after worker died of it.

        Raises
        ------
        ClusterError
            If the scheduler is lost, or a worker has other code.
        """
        from distributed import KilledWorker

        try:
            return future.result()
        except KilledWorker:
            return None
        except CancelledError:
            msg = f"--dask {self._address}: the scheduler is lost; the same command goes on with what is done"
            raise ClusterError(msg) from None
        except Exception as error:  # such as what an older wbf-mission raises
            why = one_line(str(error)) if isinstance(error, WbfMissionError) else one_line(repr(error))
            msg = f"--dask {self._address}: a worker cannot fly: {why}"
            raise ClusterError(msg) from None

    def close(self) -> None:
        """Give up what is open, and leave the workers; a local cluster ends."""
        self._client.close()
        if self._local is not None:
            self._local.close()

    def _require_workers(self) -> int:
        try:
            self._client.wait_for_workers(1, timeout=_WAIT_S)
        except TimeoutError:
            msg = f"--dask {self._address}: no worker came in {_WAIT_S:.0f} s; start some with 'dask worker'"
            raise ClusterError(msg) from None
        threads = self._client.nthreads()
        for name, count in threads.items():
            if count > 1:
                msg = f"--dask {self._address}: worker {name} has {count} threads; start it with --nthreads 1"
                raise ClusterError(msg)
        return len(threads)
