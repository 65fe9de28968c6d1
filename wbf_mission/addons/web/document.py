"""Self-contained HTML pages, with the style and scripts built into ``static``."""

from __future__ import annotations

from importlib import resources

from wbf_mission.addons.base.markup import html_document


def document(title: str, body: str, script: str, data: str = "") -> str:
    """Return a page with a script of ``static``; see `html_document` for the other parameters."""
    static = resources.files("wbf_mission.addons.web") / "static"
    style, code = ((static / name).read_text(encoding="utf-8") for name in ("page.css", f"{script}.js"))
    return html_document(title, body, style=style, script=code, data=data)
