import json

import pytest

from command_line import run


def test_scenes_are_listed(capsys):
    assert run("bench", "quality", "--list") == 0
    assert "room" in capsys.readouterr().out.split()


def test_a_table_is_printed_kept_and_resumed(tmp_path, capsys):
    arguments = (
        *("bench", "quality", "--scenes", "room", "--methods", "mv-only,C2"),
        *("--results", tmp_path / "r.jsonl", "--json", tmp_path / "t.json", "--pictures", tmp_path / "p"),
    )
    assert run(*arguments) == 0
    first = capsys.readouterr().out
    assert "room mv-only" in first
    assert "30 pixels per degree" in first
    content = json.loads((tmp_path / "t.json").read_text())
    assert set(content) == {"protocol", "rows"}
    assert [row["method"] for row in content["rows"]] == ["mv-only", "C2"]
    assert content["rows"][1]["q"] > content["rows"][0]["q"]
    assert content["protocol"]["pixels_per_degree"] == 30
    assert sorted(p.name for p in (tmp_path / "p").iterdir()) == ["room_C2.png", "room_mv-only.png"]
    kept = (tmp_path / "r.jsonl").read_text()
    assert run(*arguments) == 0
    assert (tmp_path / "r.jsonl").read_text() == kept
    assert capsys.readouterr().out == first


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("quality", "--scenes", "moon"), ("no scene moon",)),
        (("quality", "--scenes", "room", "--methods", "magic"), ("unknown method 'magic'",)),
        (("table1",), ("--data",)),
        (("quality", "--data", "nowhere"), ("nowhere",)),
        (("quality", "--scenes", "room", "--json", "no/folder.json"), ("does not exist",)),
    ],
)
def test_bad_input_is_one_sentence(tmp_path, capsys, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert run("bench", *arguments) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.startswith("error: ")
    for word in words:
        assert word in message
    assert not list(tmp_path.iterdir())


def test_everything_is_written_up(tmp_path, monkeypatch):
    pytest.importorskip("skimage")
    monkeypatch.chdir(tmp_path)
    status = run("bench", "all", "--scenes", "room", "--methods", "mv-only,C3", "--markdown", "results.md")
    assert status == 0
    page = (tmp_path / "results.md").read_text()
    assert "Made by `stereohdr bench all --scenes room --markdown results.md`" in page
    assert "room C3" in page


def test_the_metric_s_time_and_memory_are_measured(tmp_path, capsys, monkeypatch):
    from stereohdr.bench import metric_speed

    monkeypatch.setattr(metric_speed, "SIZE", (40, 50, 3))
    assert run("bench", "metric", "--json", tmp_path / "m.json") == 0
    assert "float64 images" in capsys.readouterr().out
    assert json.loads((tmp_path / "m.json").read_text())["peak_images"] > 1
