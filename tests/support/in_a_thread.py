"""Something beside a test that works in a thread for as long as it is entered."""

import threading


class InAThread:
    """Calls `_run` in a thread, which ends when `_stopping` is set, and `_close` after it."""

    def __init__(self):
        self._stopping = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self):
        raise NotImplementedError

    def _close(self):
        raise NotImplementedError

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stopping.set()
        self._thread.join(10.0)
        self._close()
