import numpy as np
import pytest

from stereohdr import ResponseCurve
from stereohdr.errors import FileFormatError, ResponseError
from stereohdr.io.response_files import read_response, read_response_table, write_response_table

EXPOSURES = (np.arange(256) + 0.5) / 128.5
"""A linear response, 1 at code 128."""


def stored(tmp_path, text, name="curve.txt"):
    (tmp_path / name).write_text(text)
    return tmp_path / name


@pytest.mark.parametrize("separator", [" ", "\n", ", ", ";"])
def test_256_numbers_in_any_arrangement(tmp_path, separator):
    path = stored(tmp_path, separator.join(f"{3 * value:.9g}" for value in EXPOSURES))
    curve = read_response(path)
    assert curve.channels == 1
    np.testing.assert_allclose(np.exp(curve.log_exposure[0]), EXPOSURES, rtol=1e-7)
    assert read_response(path, channels=3).channels == 3


@pytest.mark.parametrize("counted", [False, True])
@pytest.mark.parametrize("heading", ["", "red,green,blue\n"])
def test_tables_of_three_columns(tmp_path, heading, counted):
    rows = [[*([code] if counted else []), *(x**p for p in (1, 2, 3))] for code, x in enumerate(EXPOSURES)]
    path = stored(tmp_path, heading + "\n".join(",".join(f"{v:.12g}" for v in row) for row in rows), "c.csv")
    g = read_response(path).log_exposure
    for channel, power in enumerate((1, 2, 3)):
        np.testing.assert_allclose(g[channel], power * np.log(EXPOSURES), atol=1e-6)


def test_logarithms_are_told_by_a_negative_value_or_by_the_heading(tmp_path):
    negative = stored(tmp_path, "\n".join(f"{value:.9f}" for value in np.log(EXPOSURES)))
    np.testing.assert_allclose(read_response(negative).log_exposure[0], np.log(EXPOSURES), atol=1e-8)
    shifted = "\n".join(f"{value + 9:.9f}" for value in np.log(EXPOSURES))
    named = stored(tmp_path, "ln exposure\n" + shifted, "named.csv")
    np.testing.assert_allclose(read_response(named).log_exposure[0], np.log(EXPOSURES), atol=1e-8)
    unnamed = read_response(stored(tmp_path, shifted, "unnamed.csv")).log_exposure[0]
    np.testing.assert_allclose(unnamed[255], np.log((np.log(EXPOSURES[255]) + 9) / 9), atol=1e-6)


def test_an_exposure_of_zero_at_code_zero_is_half_of_the_next(tmp_path):
    path = stored(tmp_path, " ".join(map(str, range(256))))
    np.testing.assert_allclose(np.exp(read_response(path).log_exposure[0, :3]) * 128, [0.5, 1, 2])


@pytest.mark.parametrize("channels", [1, 3])
def test_what_is_written_is_read_back(tmp_path, channels):
    curve = ResponseCurve.srgb(channels)
    write_response_table(tmp_path / "c.csv", curve)
    np.testing.assert_allclose(read_response(tmp_path / "c.csv").log_exposure, curve.log_exposure, atol=1e-6)
    # By an independent reader, too: plain columns of code and ln exposure.
    table = np.loadtxt(tmp_path / "c.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 0], np.arange(256))
    np.testing.assert_allclose(table[:, 1:].T, curve.log_exposure, atol=1e-6)
    curve.save(tmp_path / "c.json")
    np.testing.assert_array_equal(read_response(tmp_path / "c.json").log_exposure, curve.log_exposure)


def test_named_responses_and_files_of_the_same_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    linear = read_response("linear", channels=3, white_level=4095)
    table = linear.exposure_table(4095)[2]
    np.testing.assert_allclose(table[17:] / table[1000], np.arange(17, 4096) / 1000, rtol=1e-9)
    np.testing.assert_array_equal(read_response("srgb").log_exposure, ResponseCurve.srgb(1).log_exposure)
    (tmp_path / "linear").write_text(" ".join(f"{value**2}" for value in EXPOSURES))
    np.testing.assert_allclose(read_response("linear").log_exposure[0], 2 * np.log(EXPOSURES), atol=1e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "it holds 0 numbers"),
        ("1 2 3", "it holds 3 numbers in 1 rows"),
        ("1\n" * 256, "do not rise at every code"),
        ("\n".join(map(str, range(256, 0, -1))), "do not rise"),
        ("1 2\n" * 256, "it has 2 columns"),
        ("nan\n" * 256, "not finite"),
        ("1\n2\nthree\n", "something else than numbers"),
        ("\n".join(str(1e3 * code - 5) for code in range(256)), r"within \+-40"),
        ("1e400\n" * 256, "not finite"),
    ],
)
def test_anything_else_is_refused_with_what_is_accepted(tmp_path, text, message):
    with pytest.raises(
        FileFormatError, match=rf"curve\.txt: not a response curve: .*{message}.*; give 256 rising"
    ):
        read_response_table(stored(tmp_path, text))


def test_files_that_cannot_be_read(tmp_path):
    for name in ("missing.csv", "missing.json"):
        with pytest.raises(FileFormatError, match=rf"{name}: no such file; check"):
            read_response(tmp_path / name)
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x80" * 99)
    with pytest.raises(FileFormatError, match="it is not a text file"):
        read_response(tmp_path / "binary.csv")
    ResponseCurve.srgb(3).save(tmp_path / "c.json")
    with pytest.raises(ResponseError, match=r"c\.json: the response curve has 3 channels, the photos have 1"):
        read_response(tmp_path / "c.json", channels=1)


def test_the_calibration_of_a_real_rig(shared_data):
    curve = read_response(shared_data / "boreal" / "calibration" / "pcalib_inside1.txt", channels=3)
    assert curve.channels == 3
    assert curve.is_monotone
