"""A headless Chromium that opens written pages, told what to do by its DevTools protocol over a pipe.

https://chromedevtools.github.io/devtools-protocol/: JSON messages, each ended by a zero byte.
"""

import base64
import contextlib
import json
import os
import select
import shutil
import subprocess
import time
from dataclasses import dataclass

LONGEST_S = 120.0
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@dataclass(frozen=True)
class Seen:
    """How a page is: `errors` of its console and its files, its picture as PNG, and `values` asked for."""

    errors: list
    png: bytes
    values: dict


class Browser:
    """Chromium with a profile of its own in a folder."""

    def __init__(self, folder):
        to_read, self._write = os.pipe()
        self._read, to_write = os.pipe()
        flags = "--headless --no-sandbox --disable-gpu --no-first-run --disable-dev-shm-usage"
        # Chromium reads from descriptor 3 and writes to 4.
        command = f'exec "$0" "$@" 3<&{to_read} 4>&{to_write} {to_read}<&- {to_write}>&-'
        self._process = subprocess.Popen(
            [
                "bash",
                "-c",
                command,
                CHROMIUM,
                *flags.split(),
                "--remote-debugging-pipe",
                f"--user-data-dir={folder}",
            ],
            pass_fds=(to_read, to_write),
            stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(to_write)
        self._received, self._events, self._number = b"", [], 0

    def close(self):
        try:
            with contextlib.suppress(OSError, EOFError):
                self._call("Browser.close")
            self._process.wait(LONGEST_S)
        finally:
            self._process.kill()
            self._process.wait()
            os.close(self._write)
            os.close(self._read)

    def look(self, url, *, width, dark, values):
        """Open a page in a window so wide; `values` are expressions by name."""
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]

        def tell(method, **params):
            return self._call(method, session, **params)

        for domain in ("Page", "Runtime", "Log", "Network"):
            tell(f"{domain}.enable")
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        tell("Emulation.setEmulatedMedia", features=[scheme])
        tell("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
        self._events.clear()
        tell("Page.navigate", url=url)
        while not any(event["method"] == "Page.loadEventFired" for event in self._events):
            self._events.append(self._next())
        found = {
            name: tell("Runtime.evaluate", expression=text, returnByValue=True)["result"].get("value")
            for name, text in values.items()
        }
        png = base64.b64decode(tell("Page.captureScreenshot", captureBeyondViewport=True)["data"])
        errors = [event for event in self._events if self._is_error(event)]
        self._call("Target.closeTarget", targetId=target)
        return Seen(errors, png, found)

    @staticmethod
    def _is_error(event):
        method, params = event["method"], event["params"]
        return (
            method in {"Runtime.exceptionThrown", "Network.loadingFailed"}
            or (method == "Runtime.consoleAPICalled" and params["type"] in {"error", "warning", "assert"})
            or (method == "Log.entryAdded" and params["entry"]["level"] in {"error", "warning"})
        )

    def _call(self, method, session=None, **params):
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if session is not None:
            message["sessionId"] = session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]
            self._events.append(answer)

    def _next(self):
        until = time.monotonic() + LONGEST_S
        while b"\0" not in self._received:
            ready, _, _ = select.select([self._read], [], [], max(0.0, until - time.monotonic()))
            if not ready:
                raise TimeoutError(f"Chromium said nothing for {LONGEST_S:g} s")
            data = os.read(self._read, 1 << 16)
            if not data:
                raise EOFError("Chromium ended")
            self._received += data
        message, _, self._received = self._received.partition(b"\0")
        return json.loads(message)
