import re

import numpy as np
import pytest

from stereohdr import read_hdr, read_photo, tonemap, write_hdr
from stereohdr.cli.outputs import HDR_SUFFIXES as SUFFIXES_IN_HELP
from stereohdr.io.hdr import HDR_SUFFIXES, read_hdr_with_attributes

from command_line import run

SCENE = (np.random.default_rng(2).lognormal(0, 0.5, (20, 30, 1)) * [1, 0.8, 0.6]).astype(np.float32)


@pytest.fixture
def source(tmp_path):
    write_hdr(tmp_path / "in.exr", SCENE, attributes={"method": "paper", "exposureTimeMain": 0.25})
    return tmp_path / "in.exr"


@pytest.mark.parametrize("suffix", HDR_SUFFIXES)
def test_radiance_and_attributes_are_carried_over(tmp_path, source, suffix, capsys):
    target = tmp_path / f"out{suffix}"
    assert run("convert", source, target) == 0
    assert capsys.readouterr().out == f"wrote {target}\n"
    image, attributes = read_hdr_with_attributes(target)
    assert np.median(np.abs(image - SCENE) / SCENE) < 0.03
    assert attributes in ({}, {"method": "paper", "exposureTimeMain": 0.25})
    assert run("convert", target, tmp_path / "back.npy") == 0
    np.testing.assert_array_equal(read_hdr(tmp_path / "back.npy"), image)


def test_options_arrive(tmp_path, source):
    options = {
        "a.jpg": {"white": 2.0, "headroom": 2.5, "operator": "mai", "quality": 80},
        "b.avif": {"white": 2.0, "quality": 100, "bits": 12},
        "c.jxl": {"white": 2.0, "half": True},
        "d.exr": {"half": True},
    }
    for name, given in options.items():
        words = [f"--{option}" if value is True else f"--{option}={value}" for option, value in given.items()]
        assert run("convert", source, tmp_path / name, *words) == 0
        attributes = {"exposureTimeMain": 0.25, "method": "paper"}  # OpenEXR sorts them
        write_hdr(tmp_path / f"expected-{name}", SCENE, attributes=attributes, **given)
        assert (tmp_path / name).read_bytes() == (tmp_path / f"expected-{name}").read_bytes()
    base = read_photo(tmp_path / "a.jpg", exposure_time=1.0).codes.astype(int)
    assert np.abs(base - tonemap(SCENE, "mai")).mean() < 10


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["in.exr", "out.png"], "not an HDR format"),
        (["in.exr", "in.exr"], "would overwrite"),
        (
            ["in.exr", "out.hdr", "--half"],
            "have no option 'half'; leave it out, or write .exr or .jxl",
        ),
        (["in.exr", "out.jpg", "--quality", "0"], "quality must be from 1 to 100"),
        (["none.exr", "out.hdr"], "no such file"),
        (["in.exr", "no/out.hdr"], "does not exist"),
    ],
)
def test_refusals_write_nothing(tmp_path, source, capsys, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    assert run("convert", *words) == 2
    assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["in.exr"]


def test_the_help_names_every_format():
    assert set(re.findall(r"\.[a-z]+", SUFFIXES_IN_HELP)) == set(HDR_SUFFIXES) - {".tiff", ".jpeg"}
