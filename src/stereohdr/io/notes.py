"""What a file says about its image besides the pixels, for formats without named attributes: JSON in XMP or text.

References
----------
Adobe, "XMP specification", part 1 (the packet) and part 3 (where files keep it).
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from html import escape, unescape
from typing import Any

import numpy as np

from stereohdr.errors import InputError

WHITE = "radianceOfWhite"
"""Attribute with the factor from file to radiance: the radiance that is stored as diffuse white, 1."""

WHITE_RANGE = (1e-30, 1e30)
"""Radiance that is accepted as diffuse white: float32 holds its products with 10,000 and their inverses."""

NAMESPACE = "urn:stereohdr:attributes:1#"

_PACKET = re.compile(rb"<stereohdr:attributes>([^<]{1,1000000})</stereohdr:attributes>")


def attributes_to_json(attributes: Mapping[str, Any]) -> str:
    """Return attributes as ASCII JSON; numbers that JSON does not know, such as NaN, as text.

    Raises
    ------
    InputError
        A value is no string, number, or sequence of those.
    """
    return json.dumps({name: _plain(name, value) for name, value in attributes.items()}, allow_nan=False)


def attributes_from_json(text: str) -> dict[str, Any]:
    """Return what `attributes_to_json` was given (sequences as tuples); empty for any other text."""
    try:
        content = _with_tuples(json.loads(text))
    except (ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def attributes_to_rdf(attributes: Mapping[str, Any]) -> str:
    """Return attributes as a description for `xmp_packet`."""
    creator = escape(str(attributes.get("software", "stereohdr")), quote=True)
    return (
        '<rdf:Description rdf:about="" xmlns:xmp="http://ns.adobe.com/xap/1.0/" '
        f'xmlns:stereohdr="{NAMESPACE}">\n'
        f"<xmp:CreatorTool>{creator}</xmp:CreatorTool>\n"
        f"<stereohdr:attributes>{escape(attributes_to_json(attributes), quote=False)}</stereohdr:attributes>\n"
        "</rdf:Description>\n"
    )


def xmp_packet(*descriptions: str) -> bytes:
    """Return an XMP packet with descriptions in RDF/XML; some readers look at the first one only."""
    text = (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n'
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
        f"{''.join(descriptions)}"
        "</rdf:RDF></x:xmpmeta>\n"
        '<?xpacket end="r"?>'
    )
    return text.encode("utf-8", "backslashreplace")


def unpack_xmp(packet: bytes) -> dict[str, Any]:
    """Return the attributes that `attributes_to_rdf` put into an XMP packet; empty for other programs' packets."""
    match = _PACKET.search(packet)
    return attributes_from_json(unescape(match[1].decode("utf-8", "replace"))) if match else {}


def take_white(attributes: dict[str, Any]) -> float:
    """Remove `WHITE` from attributes and return it; 1 if it is not there, or no such number."""
    white = attributes.pop(WHITE, 1.0)
    usable = isinstance(white, int | float) and WHITE_RANGE[0] <= white <= WHITE_RANGE[1]
    return float(white) if usable else 1.0


def _with_tuples(content: Any) -> Any:
    if isinstance(content, dict):
        return {name: _with_tuples(value) for name, value in content.items()}
    return tuple(map(_with_tuples, content)) if isinstance(content, list) else content


def _plain(name: str, value: Any) -> Any:
    if isinstance(value, str | bool):
        return value
    if isinstance(value, int | np.integer | np.bool_):
        return int(value)
    if isinstance(value, float | np.floating):
        number = float(value)
        return number if math.isfinite(number) else str(number)
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(name, item) for item in value]
    raise InputError(
        f"attribute {name!r} must be a string, a number, or a sequence of those, got {type(value).__name__}"
    )
