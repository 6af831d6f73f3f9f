import json
from dataclasses import replace

import numpy as np
import pytest

from stereohdr.bench import speed
from stereohdr.bench.machine import describe_machine
from stereohdr.bench.peers import pandora_matcher
from stereohdr.bench.rows import peak_mib
from stereohdr.bench.speed import CASES, Case, Work, benchmark_pairs
from stereohdr.bench.speed_page import GOALS, goals_table, growth, speed_page
from stereohdr.bench.stage_speed import array_bytes
from stereohdr.model import Disparity
from stereohdr.radiance import exposure_map

from command_line import run

TINY = Case(96, 72, 16, rounds=2, contenders=CASES["small"].contenders)
LARGER = Case(128, 72, 32, rounds=1, contenders=("alone",))


def test_everything_is_measured_printed_and_written(tmp_path, capsys, monkeypatch):
    pytest.importorskip("cv2")
    monkeypatch.setattr(speed, "CASES", {"small": TINY, "large": LARGER})
    files = ("--json", tmp_path / "s.json", "--markdown", tmp_path / "performance.md")
    assert run("bench", "speed", "--cases", "all", *files) == 0
    printed = capsys.readouterr().out
    content = json.loads((tmp_path / "s.json").read_text())

    timed = {"robust", "robust-shadows", "paper", "sgm"}
    assert set(content["ratio_to_hh"]) - {"pandora-96x72x16"} == {f"{name}-96x72x16" for name in timed}
    assert all(ratio > 0 for ratio in content["ratio_to_hh"].values())
    assert content["seconds"]["robust-96x72x16"]["turns"] == 2
    assert content["seconds"]["robust-128x72x32"]["turns"] == 1
    times = content["seconds"]["hdrvdp2-96x72x16"]
    assert 0 < times["least"] <= times["median"] <= times["most"]
    assert list(content["growth"]) == ["96x72x16", "128x72x32"]
    assert content["growth"]["128x72x32"] == pytest.approx(
        1e9 * content["seconds"]["robust-128x72x32"]["median"] / (128 * 72 * 32)
    )
    stages = content["stages"]["robust-96x72x16"]
    assert {"survey", "disparity", "fusion"} <= set(stages)
    assert stages["survey"]["ms_per_mpx"] == pytest.approx(stages["survey"]["ms"] / (96 * 72 / 1e6))
    assert len(content["building_blocks"]) == 6
    for peak in content["peak_mib"].values():
        assert 0 < peak["above_imports"] < peak["in_all"] < 2000
    assert not content["failed"]

    page = (tmp_path / "performance.md").read_text()
    assert "`stereohdr bench speed --cases all --json s.json --markdown performance.md`" in page
    assert content["machine"]["processor"] in page
    for words in ("census of both views", "| fusion", "hh-96x72x16", "| 128x72x32"):
        assert words in page
        assert words in printed
    assert sorted(path.name for path in tmp_path.iterdir()) == ["performance.md", "s.json"]


def test_without_opencv_one_sentence_says_so(capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "cv2", None)
    monkeypatch.setattr(speed, "CASES", {"small": TINY})
    assert run("bench", "speed", "--cases", "small") == 1
    assert capsys.readouterr().err.strip().splitlines()[-1] == (
        "error: bench speed measures in units of OpenCV's StereoSGBM; install stereohdr[opencv]"
    )


def test_outputs_are_checked_before_anything_is_timed(capsys, monkeypatch):
    monkeypatch.setattr(speed, "measure_speed", None)
    assert run("bench", "speed", "--json", "no/folder.json") == 2
    assert "does not exist" in capsys.readouterr().err


def test_what_fails_alone_is_said_and_the_rest_is_there(monkeypatch):
    impossible = replace(LARGER, disparities=4000)
    monkeypatch.setattr(speed, "CASES", {"large": impossible})
    document = speed.measure_speed(["large"])
    assert "disparit" in document["failed"]["robust-128x72x4000"]
    assert not document["seconds"]
    assert "robust-128x72x4000: not timed: " in speed_page({**document, "command": "x"})


@pytest.mark.parametrize("case", [TINY, CASES["small"]])
def test_the_pairs_fit_the_case(case):
    case = replace(case, width=min(case.width, 240), height=min(case.height, 192), disparities=40)
    pairs = benchmark_pairs(case)
    assert set(pairs) == {"highlights", "shadows"}
    for kind, pair in pairs.items():
        assert pair.left.codes.shape == (case.height, case.width, 3)
        assert (pair.exposures[0] > pair.exposures[1]) == (kind == "highlights")
        assert pair.exposure_ratio == 16
        assert 0.03 < exposure_map(pair.main_photo).mean() < 0.97
    again = benchmark_pairs(case)["highlights"]
    assert np.array_equal(again.left.codes, pairs["highlights"].left.codes)


def test_large_pairs_are_enlarged(monkeypatch):
    monkeypatch.setattr(speed, "LARGEST_RENDERED", 60)
    pair = benchmark_pairs(replace(TINY, width=150, height=101))["highlights"]
    assert pair.left.codes.shape == (101, 150, 3)


def test_the_large_case_is_compared_with_a_small_one(monkeypatch):
    monkeypatch.setattr(speed, "CASES", {"small": TINY, "large": replace(LARGER, options={"memory": "1GiB"})})
    document = speed.measure_speed(["large"])
    assert list(document["growth"]) == ["96x72x16", "128x72x32"]
    assert document["seconds"]["robust-96x72x16"]["turns"] == 2
    assert set(document["peak_mib"]) == {"robust-96x72x16", "robust-128x72x32"}
    assert not document["failed"]
    assert [case.label for case in speed._cases(["small", "large"])] == ["96x72x16", "128x72x32"]
    assert CASES["large"].options == {"memory": "4GiB"}
    assert list(benchmark_pairs(TINY, kinds=["shadows"])) == ["shadows"]


def test_a_limit_that_is_too_small_is_said(monkeypatch):
    monkeypatch.setattr(speed, "CASES", {"large": replace(LARGER, options={"memory": "1MiB"})})
    assert "--memory" in speed.measure_speed(["large"])["failed"]["robust-128x72x32"]


def test_turns_are_counted_and_limited():
    calls = []
    work = Work("x", lambda: calls.append(1), most=2)
    for _ in range(4):
        work.take_turn()
    assert len(calls) == len(work.wall) == len(work.cpu) == 2


def test_array_bytes_looks_into_sequences_and_dataclasses():
    a = np.zeros((3, 4), np.float32)
    assert array_bytes([a, (a, 5, "x")]) == 96
    assert array_bytes(Disparity(a, np.zeros((3, 4), np.uint8))) == 60
    assert array_bytes(None) == 0


def test_growth_is_the_worst_of_all_sizes():
    assert growth({"growth": {"a": 2.0, "b": 3.0, "c": 1.0}}) == 1.5
    assert growth({"growth": {"a": 2.0}}) is None


def test_goals_that_are_missed_say_so():
    nothing = {"ratio_to_hh": {}, "seconds": {}, "peak_mib": {}, "growth": {}}
    lines = goals_table(nothing).splitlines()
    assert len(lines) == 2 + len(GOALS)
    assert all(line.rstrip().endswith("- |") for line in lines[2:])
    slow = {**nothing, "ratio_to_hh": {"robust-695x555x120": 2.1, "paper-695x555x120": 3.9}}
    reached = [line.split("|")[-2].strip() for line in goals_table(slow).splitlines()[2:]]
    assert sorted(reached) == ["-"] * (len(GOALS) - 2) + ["missed", "yes"]


def test_the_machine_is_described():
    machine = describe_machine()
    assert machine["processor"]
    assert machine["cores"] >= 1
    assert {"python", "numpy", "numba"} <= set(machine["versions"])
    json.dumps(machine)


def test_the_peak_grows_with_what_is_held():
    before = peak_mib()
    held = np.ones(200 * 2**20, np.uint8)
    after = peak_mib()
    assert before is not None
    assert after is not None
    assert after >= held.nbytes / 2**20
    assert after - before < 250


def test_pandora_is_a_peer_where_it_is_installed():
    pytest.importorskip("pandora")
    pytest.importorskip("pandora_plugin_libsgm")
    rng = np.random.default_rng(0)
    texture = rng.integers(0, 255, (40, 70), dtype=np.uint8)
    call = pandora_matcher(texture[:, :60], texture[:, 7:67], 16)
    assert call is not None
    left, _ = call()
    assert np.nanmedian(left["disparity_map"].data[8:-8, 20:-8]) == pytest.approx(-7, abs=0.1)
