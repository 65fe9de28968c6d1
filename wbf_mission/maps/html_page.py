"""HTML documents that are whole in one file: they load nothing, and run no script but their own.

Whoever writes a page for people makes it here, so that each has the same policy (Content Security Policy,
https://www.w3.org/TR/CSP3/): styles and scripts by their digests, pictures by their data, nothing else.
"""

from __future__ import annotations

import base64
import hashlib
import zlib
from html import escape
from typing import Any

import msgspec


def html_document(title: str, body: str, *, style: str, script: str = "", data: str = "") -> str:
    """Return a document.

    Parameters
    ----------
    title : str
        Plain text.
    body : str
        HTML; it has no style attributes and no handlers of events, which the policy forbids.
    style, script : str
        CSS and JavaScript; the script runs when the body is there.
    data : str
        HTML with what the script needs, see `data_element`.
    """
    style, script = style.replace("</style", "<\\/style"), script.replace("</script", "<\\/script")
    own_script = _digest(script) if script else "'none'"
    policy = (
        f"default-src 'none'; img-src data: blob:; style-src {_digest(style)}; script-src {own_script};"
        " base-uri 'none'; form-action 'none'"
    )
    run = f"<script>{script}</script>\n" if script else ""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{style}</style></head>\n"
        f"<body>\n{body}\n{data}{run}</body></html>\n"
    )


def data_element(name: str, data: Any, *, packed: bool = False) -> str:
    """Return an element with this id that holds what msgspec can encode, as JSON.

    Packed, its text is base64 of the JSON packed by zlib, and ``data-packed`` is "deflate".
    """
    json = msgspec.json.encode(data)
    if packed:
        text, how = base64.b64encode(zlib.compress(json, 9)).decode(), ' data-packed="deflate"'
    else:
        # The parser of HTML looks for the end of a script, and for comments, also in JSON.
        text, how = json.decode().replace("<", "\\u003c"), ""
    return f'<script type="application/json" id="{name}"{how}>{text}</script>\n'


def data_uri(content: bytes, kind: str = "image/png") -> str:
    """Return an address that holds a picture itself."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
