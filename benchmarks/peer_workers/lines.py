"""Questions and answers as lines of JSON, for programs that run in another virtual environment."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from typing import Any


def serve(answer: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """Answer each line of the standard input by one on the standard output, until the input ends.

    An empty answer tells that the libraries are there. What libraries print goes to the standard error. An
    error is an answer, too.
    """
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    sys.stdout = sys.stderr
    out.write("{}\n")
    out.flush()
    for line in sys.stdin:
        try:
            told = answer(json.loads(line))
        except Exception as error:
            told = {"error": " ".join(f"{type(error).__name__}: {error}".split())[:500]}
        out.write(json.dumps(told) + "\n")
        out.flush()
