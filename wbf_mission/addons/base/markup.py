"""Makes documents of HTML and XML: HTML in a single file that loads no other resource.

All HTML documents are made here, so that they share one Content Security Policy
(https://www.w3.org/TR/CSP3/). The policy allows the document's own style and script by their digests, and
pictures as data or blob URLs.
"""

from __future__ import annotations

import base64
import hashlib
import zlib
from html import escape
from typing import Any
from xml.etree import ElementTree

import msgspec
import numpy as np


def html_document(title: str, body: str, *, style: str, script: str = "", data: str = "") -> str:
    """Return an HTML document with its Content Security Policy.

    `title` is plain text. `body` is HTML without style attributes and event handlers, which the policy
    forbids. `script` runs after the body has been parsed; `data` has the data elements (`data_element`).
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
    """Return an element with the id `name` and `data` as JSON, encoded by msgspec.

    If `packed`, the JSON is compressed by zlib and encoded as base64; ``data-packed`` is "deflate".
    """
    json = msgspec.json.encode(data)
    if packed:
        text, how = base64.b64encode(zlib.compress(json, 9)).decode(), ' data-packed="deflate"'
    else:
        # HTML parsers look for "</script" and "<!--" in JSON, too.
        text, how = json.decode().replace("<", "\\u003c"), ""
    return f'<script type="application/json" id="{name}"{how}>{text}</script>\n'


def data_uri(content: bytes, kind: str = "image/png") -> str:
    """Return a data URL of `content`; `kind` is the MIME type."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


GPX = {"version": "1.1", "creator": "wbf-mission", "xmlns": "http://www.topografix.com/GPX/1/1"}
"""Attributes of the root of a GPX file."""


def decimal(value: float) -> str:
    """Return a number as an XML decimal, without exponent; reading it gives exactly this number.

    >>> decimal(1e-7), decimal(30)
    ('0.0000001', '30.0')
    """
    return np.format_float_positional(float(value), unique=True, trim="0")


def document(root: ElementTree.Element) -> str:
    """Return an XML document as text, with one element per line."""
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def add(
    parent: ElementTree.Element, tag: str, text: str | None = None, **attributes: str
) -> ElementTree.Element:
    """Add a child element to `parent` and return the child."""
    made = ElementTree.SubElement(parent, tag, attributes)
    made.text = text
    return made
