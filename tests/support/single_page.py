"""A page in one file, taken apart: what it loads, what it may run, and what it holds."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import zlib
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

_LOADS = ("src", "href", "action", "data", "poster", "srcset", "formaction", "xlink:href")


class SinglePage(HTMLParser):
    """Its tags, addresses and texts."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.source = file.read_text(encoding="utf-8")
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.words: list[str] = []
        self.scripts: list[tuple[dict[str, str], str]] = []
        self.policy = ""
        self._inside: str = ""
        self.feed(self.source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        known = {name: value or "" for name, value in attrs}
        self.tags.append(tag)
        self.attributes += known.items()
        self._inside = tag
        if known.get("http-equiv") == "Content-Security-Policy":
            self.policy = known["content"]
        if tag in ("script", "style"):
            self.scripts.append((known, ""))

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside in ("script", "style"):
            known, text = self.scripts[-1]
            self.scripts[-1] = known, text + data
        else:
            self.words.append(data)

    def check(self) -> None:
        """Fail unless it loads nothing, and runs nothing but what its policy names."""
        loads = [value for name, value in self.attributes if name in _LOADS]
        assert [one for one in loads if not one.startswith(("data:image/png;base64,", "#"))] == []
        assert [name for name, _ in self.attributes if name == "style" or name.startswith("on")] == []
        style, *scripts = (text for known, text in self.scripts if "type" not in known)
        assert re.search(r"@import|url\((?!['\"]?(?:data:|#))", style) is None
        parts = dict(part.strip().split(" ", 1) for part in self.policy.split(";"))
        assert (parts["default-src"], parts["img-src"]) == ("'none'", "data: blob:")
        assert parts["style-src"] == _digest(style)
        assert parts["script-src"] == (_digest(scripts[0]) if scripts else "'none'")
        assert len(scripts) <= 1

    def held(self, name: str) -> Any:
        """Return the data of an element."""
        known, text = next(one for one in self.scripts if one[0].get("id") == name)
        packed = known.get("data-packed") == "deflate"
        return json.loads(zlib.decompress(base64.b64decode(text)) if packed else text)


def _digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
