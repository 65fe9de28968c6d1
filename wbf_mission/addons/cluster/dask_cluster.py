"""Flies the runs of a benchmark on the workers of a Dask scheduler."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from typing import Any, TypeVar

from geo.errors import WbfMissionError
from geo.imports import load_extra
from geo.texts import one_line
from wbf_mission.bench.engine import ClusterError

_T = TypeVar("_T")
_LOCAL = "local"
_WAIT_S = 60.0


class DaskCluster:
    """Workers of the Dask scheduler at `address`; up to `most` runs are submitted at a time.

    The address ``local`` starts a cluster with `workers` workers on the loopback interface; `close` ends it.

    Raises ClusterError if Dask is not installed, the scheduler does not answer or has no workers, or a worker
    has several threads: each run needs a separate process.
    """

    def __init__(self, address: str, workers: int) -> None:
        dask = load_extra("distributed", "dask", "--dask needs", ClusterError)
        self._local: Any = None
        self._address = address
        if address == _LOCAL:
            self._local = dask.LocalCluster(
                n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
            )
        try:
            self._client = dask.Client(self._local or address, set_as_default=False)
        except (OSError, ValueError) as error:  # TimeoutError is a kind of OSError.
            why = one_line(str(error)) or "no answer"
            raise ClusterError(f"--dask {address}: no scheduler answers at this address ({why})") from None
        try:
            self.most = 2 * self._require_workers()
            self._executor = self._client.get_executor(pure=False)
        except BaseException:
            self.close()
            raise

    def submit(self, function: Callable[..., _T], /, *arguments: Any) -> Future[_T]:
        """Submit a call to the workers; only the name of the function is sent, not its code."""
        return self._executor.submit(function, *arguments)

    def result(self, future: Future[_T]) -> _T | None:
        """Return the result of a finished future; None if the call killed several workers.

        Raises ClusterError if the scheduler is lost, or a worker raises an error.
        """
        from distributed import KilledWorker

        try:
            return future.result()
        except KilledWorker:
            return None
        except CancelledError:
            msg = f"--dask {self._address}: the scheduler is lost; repeat the command to fly the missing runs"
            raise ClusterError(msg) from None
        except Exception as error:  # Any error of the worker, for example of an older wbf-mission
            why = one_line(str(error)) if isinstance(error, WbfMissionError) else one_line(repr(error))
            raise ClusterError(f"--dask {self._address}: a worker cannot fly: {why}") from None

    def close(self) -> None:
        """Cancel the pending runs and disconnect; a local cluster is stopped."""
        self._client.close()
        if self._local is not None:
            self._local.close()

    def _require_workers(self) -> int:
        try:
            self._client.wait_for_workers(1, timeout=_WAIT_S)
        except TimeoutError:
            msg = f"--dask {self._address}: no worker after {_WAIT_S:.0f} s; start workers: 'dask worker'"
            raise ClusterError(msg) from None
        threads = self._client.nthreads()
        for name, count in threads.items():
            if count > 1:
                msg = f"--dask {self._address}: worker {name} has {count} threads; start it with --nthreads 1"
                raise ClusterError(msg)
        return len(threads)
