import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from stereohdr.errors import InputError
from stereohdr.io.notes import (
    WHITE,
    attributes_from_json,
    attributes_to_json,
    attributes_to_rdf,
    take_white,
    unpack_xmp,
    xmp_packet,
)

GIVEN = {
    "text": 'über <b> & "quotes" \n zwei',
    "number": 0.1,
    "numpy": np.float32(1.5),
    "count": 7,
    "flag": True,
    "huge": 2**70,
    "times": [0.5, 0.25],
    "array": np.arange(3),
    "names": ("left", "right"),
    "nan": float("nan"),
}
EXPECTED = {
    **GIVEN,
    "numpy": 1.5,
    "times": (0.5, 0.25),
    "array": (0, 1, 2),
    "nan": "nan",
}


def test_json_round_trip():
    text = attributes_to_json(GIVEN)
    assert text.isascii()
    json.loads(text, parse_constant=pytest.fail)  # no NaN, which is not JSON
    assert attributes_from_json(text) == EXPECTED


@pytest.mark.parametrize("text", ["", "hello", "[1, 2]", "3", "[" * 100_000, '{"a": '])
def test_other_text_means_no_attributes(text):
    assert attributes_from_json(text) == {}


@pytest.mark.parametrize("value", [None, {"a": 1}, [None], 1j, object()])
def test_other_types_are_refused(value):
    with pytest.raises(InputError, match="attribute 'x' must be a string, a number"):
        attributes_to_json({"x": value})


def test_xmp_is_well_formed_and_holds_the_attributes():
    packet = xmp_packet(attributes_to_rdf({"software": "a <b> & 'c'", **GIVEN}))
    root = ElementTree.fromstring(packet.decode().split("?>", 1)[1].rsplit("<?", 1)[0])
    creator = root.find(".//{http://ns.adobe.com/xap/1.0/}CreatorTool")
    assert creator is not None
    assert creator.text == "a <b> & 'c'"
    assert unpack_xmp(packet) == {"software": "a <b> & 'c'", **EXPECTED}


@pytest.mark.parametrize(
    "packet", [b"", b"<x:xmpmeta/>", b"<stereohdr:attributes></stereohdr:attributes>", b"\xff" * 50]
)
def test_other_packets_mean_no_attributes(packet):
    assert unpack_xmp(packet) == {}


def test_a_lone_surrogate_does_no_harm():
    assert unpack_xmp(xmp_packet(attributes_to_rdf({"software": "a\ud800", "name": "\ud800"})))["name"] == "\ud800"


@pytest.mark.parametrize(
    ("value", "white"), [(2.5, 2.5), (3, 3.0), (0, 1.0), (-1, 1.0), (1e300, 1.0), ("x", 1.0), ((1, 2), 1.0)]
)
def test_the_factor_is_taken_out_of_the_attributes(value, white):
    attributes = {WHITE: value, "a": 1}
    assert take_white(attributes) == white
    assert attributes == {"a": 1}
    assert take_white(attributes) == 1
