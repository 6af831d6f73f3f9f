import pytest

from stereohdr.bench import runner
from stereohdr.bench.rows import Row
from stereohdr.bench.runner import Results, compute_row, markdown_table, row_key, run_rows
from stereohdr.bench.tables import published_table, quality_table
from stereohdr.bench.write_up import compare, results_page
from stereohdr.errors import FileFormatError, InputError
from stereohdr.metrics.protocol import Protocol


def test_finished_rows_survive_in_their_file(tmp_path):
    path = tmp_path / "rows.jsonl"
    results = Results(path)
    assert results.get("a") is None
    results.add("a", Row("s", "m", q=50.0))
    results.add("b", Row("s", "n", q=None))
    again = Results(path)
    assert again.get("a") == Row("s", "m", q=50.0)
    assert again.get("b") == Row("s", "n")
    whole = path.read_text()
    path.write_text(whole + '{"key": "c", "sce')  # killed in the middle of a line
    assert Results(path).get("b") == Row("s", "n")
    assert path.read_text() == whole
    path.write_text(whole + "{broken\n")
    with pytest.raises(FileFormatError, match="line 3 is not a finished row"):
        Results(path)


def test_an_error_names_files_within_the_data(tmp_path, monkeypatch):
    def refuse(scene, data):
        raise InputError(f"{data / 'rig' / 'left.png'}: hardly anything matches")

    monkeypatch.setattr(runner, "load_scene", refuse)
    row = compute_row(tmp_path, "R6", "paper", Protocol(), 1, None)
    assert row.error.replace("\\", "/") == "rig/left.png: hardly anything matches"


def test_a_key_changes_with_everything_that_changes_a_row():
    base = row_key("room", "paper", Protocol())
    assert base == row_key("room", "paper", Protocol())
    others = {
        row_key("room2", "paper", Protocol()),
        row_key("room", "mv-only", Protocol()),
        row_key("room", "paper-no-poisson", Protocol()),
        row_key("room", "paper", Protocol(pixels_per_degree=47)),
    }
    assert len(others - {base}) == 4


def test_finished_rows_are_not_computed_again(tmp_path):
    results = Results(tmp_path / "rows.jsonl")
    kept = Row("room", "mv-only", q=12.0)
    results.add(row_key("room", "mv-only", Protocol()), kept)
    assert run_rows(None, ["room"], ["mv-only"], results=results) == [kept]


def test_rows_that_fail_say_why_and_are_tried_again(tmp_path):
    results = Results(tmp_path / "rows.jsonl")
    seen = []
    rows = run_rows(None, ["nowhere"], ["mv-only"], results=results, progress=lambda *a: seen.append(a))
    assert "nowhere" in rows[0].error
    assert seen == [(1, 1, rows[0])]
    assert not (tmp_path / "rows.jsonl").exists()


def test_markdown_is_aligned():
    table = markdown_table(["name", "x"], [["a", "1.00"], ["longer", "12"]])
    assert table == "| name   |    x |\n| ------ | ---: |\n| a      | 1.00 |\n| longer |   12 |"


def test_tables_show_ours_and_the_papers():
    rows = [
        Row("Art-short-long", "paper", q=70.0, seconds=1.0),
        Row("Art-short-long", "lin2009", q=60.0),
        Row("Aloe-short-long", "paper", q=80.0),
        Row("Aloe-short-long", "lin2009", error="no"),
    ]
    table = published_table(rows, ["lin2009", "paper"])
    assert "60.00 (79.23)" in table
    assert "70.00 (92.64)" in table
    assert "- (78.89)" in table
    assert "75.00 (91.60)" in table.splitlines()[-1]
    assert "no" not in quality_table(rows)
    assert len(quality_table(rows).splitlines()) == 5


def test_claims_are_counted_not_typed():
    rows = [
        *(Row(s, "paper", q=q, pu21_psnr=30.0) for s, q in (("a", 60.0), ("b", 50.0), ("c", 55.0))),
        *(Row(s, "opencv", q=q, pu21_psnr=31.0) for s, q in (("a", 50.0), ("b", 50.2), ("c", 57.0))),
        Row("d", "paper", q=99.0),
        Row("d", "opencv", error="no"),
    ]
    assert compare(rows, "paper", "opencv") == (
        "`paper` against `opencv`, Q: better on 1, equal on 1, worse on 1 of 3 scenes; +2.60 on average."
    )
    assert "worse on 3 of 3" in compare(rows, "paper", "opencv", "pu21_psnr")
    assert "no scene has both" in compare(rows, "paper", "lin2009")


def test_the_page_of_results_holds_all_tables():
    rows = [Row("Art-short-long", m, q=60.0, protocol="stereohdr; reference") for m in ("paper", "mv-only")]
    rows.append(Row("room", "opencv", error="is not installed"))
    steps = [Row("room", m, q=q, seconds=1.0) for m, q in (("robust", 60.0), ("robust-one-run", 58.5))]
    page = results_page(rows, rows[:1], steps, "| curves |", ["Art-short-long", "room"], "stereohdr bench all")
    for word in ("# Results", "Table 1", "Table 2", "Figure 2", "| curves |", "room, opencv: is not installed"):
        assert word in page
    assert "Art-short-long paper" in page
    assert "| -1.50 |" in next(line for line in page.splitlines() if line.startswith("| robust-one-run"))
