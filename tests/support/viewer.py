"""What a page makes of the updates that it is sent, as `schema.ts` says it does; who takes its orders."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from websockets.sync.client import ClientConnection, connect

from wbf_mission.addons.web.server import LiveServer


class Taking:
    """Orders as whoever flies takes them; some are refused, for a reason."""

    def __init__(self, refused: dict[str, str] | None = None) -> None:
        self.taken: list[tuple[Any, ...]] = []
        self.refused = refused or {}

    def take(self, *order: Any, age_s: float) -> str:
        self.taken.append(order)
        return self.refused.get(order[1], "")

    def answer(self, *answer: Any, age_s: float) -> str:
        self.taken.append(answer)
        return ""


class Clock:
    """A clock that somebody sets."""

    now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


class Viewer:
    """A page without a picture: takes updates in JSON, holds what it would show."""

    def __init__(self) -> None:
        self.time_s = 0.0
        self.run: dict[str, Any] | None = None
        self.status: dict[str, Any] = {}
        self.background: dict[str, Any] | None = None
        self.plans: list[Any] = []
        self.said: list[Any] = []
        self.decisions: dict[int, Any] = {}
        self.states: dict[str, dict[str, list[Any]]] = {}
        self.scores: dict[str, Any] = {}
        self.readings: dict[str, Any] = {}
        self.tiles: dict[tuple[str, int, int], str] = {}
        self.scales: dict[str, float] = {}
        self.replies: list[Any] = []

    def take(self, data: bytes | str) -> dict[str, Any]:
        """Take an update; return it decoded."""
        update: dict[str, Any] = json.loads(data)
        self.time_s = update["time_s"]
        for name in update.get("restart", ()):
            kind, _, key = name.partition("/")
            if key:
                self.states.pop(key, None)
            else:
                setattr(self, kind, type(getattr(self, kind))())
            if kind == "tiles":
                self.scales = {}
        for name in ("run", "status", "background"):
            if name in update:
                setattr(self, name, update[name])
        self.plans += update.get("plans", ())
        self.said += update.get("said", ())
        self.decisions |= {one["number"]: one for one in update.get("decisions", ())}
        for key, columns in update.get("states", {}).items():
            _append(self.states.setdefault(key, {}), columns)
        _append(self.scores, update.get("scores", {}), nested="losses", counted="time_s")
        _append(self.readings, update.get("readings", {}), nested="values", counted="time_s")
        self.tiles |= {(one["layer"], one["x"], one["y"]): one["data"] for one in update.get("tiles", ())}
        self.scales |= update.get("scales", {})
        self.replies += [update["reply"]] if "reply" in update else []
        return update

    def layer(self, name: str) -> np.ndarray[Any, Any]:
        """Return the bytes of a layer as [x, y]."""
        assert self.run is not None
        raster = self.run["raster"]
        side, pixels = raster["tile"], np.full((raster["width"], raster["height"]), 255, np.uint8)
        for (layer, x, y), data in self.tiles.items():
            if layer == name:
                part = pixels[x * side : (x + 1) * side, y * side : (y + 1) * side]
                raw = np.frombuffer(zlib.decompress(base64.b64decode(data)), np.uint8)
                part[...] = raw.reshape(part.shape[::-1]).T
        return pixels


def _append(columns: dict[str, Any], more: dict[str, Any], nested: str = "", counted: str = "") -> None:
    """Append columns to columns; those in `nested` may be missing on either side."""
    if not more:
        return
    known, new = len(columns.get(counted, ())), len(more.get(counted, ()))
    for name, column in more.items():
        if name == nested:
            inner = columns.setdefault(nested, {})
            for key in {**inner, **column}:
                inner[key] = inner.get(key, [None] * known) + column.get(key, [None] * new)
        else:
            columns.setdefault(name, []).extend(column)


@contextmanager
def watching(server: LiveServer, **more: Any) -> Iterator[ClientConnection]:
    """Open the stream of the live page."""
    address = f"127.0.0.1:{server.port}"
    options: dict[str, Any] = {"origin": f"http://{address}", "max_size": None, "compression": None}
    with connect(f"ws://{address}/live", **(options | more)) as client:
        yield client
