"""Requests and responses as lines of JSON, for processes in another virtual environment."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from typing import Any


def serve(answer: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """Write one response line to standard output for each request line on standard input, until its end.

    The first response is empty and confirms that the libraries were imported. Output of libraries goes to
    standard error. Errors are sent as responses.
    """
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    sys.stdout = sys.stderr
    out.write("{}\n")
    out.flush()
    for line in sys.stdin:
        try:
            response = answer(json.loads(line))
        except Exception as error:
            response = {"error": " ".join(f"{type(error).__name__}: {error}".split())[:500]}
        out.write(json.dumps(response) + "\n")
        out.flush()
