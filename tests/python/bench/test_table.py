"""Figures, and the tables of them: each comes from one commit and one processor, and names both."""

import csv
import json
import subprocess

import pytest
from messages import refused

import charts
import table
import timing

MACHINE = {"cpu": "Fast One", "logical_processors": 2, "simd": "AVX-512", "embree": "3", "python": "3.11"}
COMMIT = "0123456789abcdef0123456789abcdef01234567"
SOURCE = "Fast One, 2 logical processors, AVX-512, commit 0123456, 2026-11-24"


def result(figures=(), **changes):
    """Return a result with figures (name, value, unit, more)."""
    made = [{"name": name, "value": value, "unit": unit, "runs": 1, **more} for name, value, unit, more in figures]
    return {"machine": MACHINE, "commit": COMMIT, "commit_date": "2026-11-24", "figures": made, **changes}


def written(spec, *figures, **changes):
    """Return the lines of the tables that are not empty."""
    results = {figures[0][0].split("/")[0]: result(figures, **changes)} if figures else {}
    return [line for line in table.tables(spec, results).splitlines() if line]


def test_a_table_has_its_source_and_its_figures_by_row_and_column():
    spec = "# steps\nrace/{kind}_gates/{ticks}_ticks -> {ticks} ticks | {kind} | .2f\nopen = not solid\n"
    figures = [("race/open_gates/10_ticks", 0.354, "us", {}), ("race/solid_gates/5_ticks", 0.2986, "us", {})]
    assert written(spec, *figures, ("race/other", 1.0, "us", {})) == [
        SOURCE,
        "| steps | not solid | solid |",
        "|---|---:|---:|",
        "| 5 ticks |  | 0.30 µs |",  # in the order of their numbers
        "| 10 ticks | 0.35 µs |  |",
    ]
    assert written(spec) == ["Not measured yet."]


@pytest.mark.parametrize(
    ("value", "unit", "form", "text"),
    [
        (3303456.0, "1/s", "", "3,300,000"),
        (0.00004178, "°", "2", "0.000042°"),
        (12.0, "ms", "", "12 ms"),
        (0.0, "B", "", "0 B"),
        (0.98123, "1", ".1%", "98.1 %"),
        (4.4051, "", ".2f s", "4.41 s"),
        (1.5, "us", "", "1.5 µs"),
    ],
)
def test_numbers_are_written_for_people(value, unit, form, text):
    assert table.shown([value], unit, form) == text


def test_several_figures_of_a_cell_become_median_least_and_greatest():
    figures = [(f"train/seed{i}/success", value, "1", {}) for i, value in enumerate((0.5, 0.9, 0.7))]
    assert written("train/seed{}/success -> all | success | .0%", *figures)[-1] == "| all | 70 (50 to 90) % |"
    assert table.shown([6, 6, 6], "1", "") == "6"


def test_words_hold_for_all_tables_if_they_stand_before_the_first():
    spec = "a = one\nb = two\n# first\nt/{x}/f -> {x} | f\nb = other\n# second\nt/{x}/f -> {x} | f\n"
    lines = written(spec, ("t/a/f", 1, "1", {}), ("t/b/f", 2, "1", {}))
    assert [line for line in lines if line[2:5] in ("one", "two", "oth")] == [
        "| one | 1 |",
        "| other | 2 |",
        "| one | 1 |",
        "| two | 2 |",
    ]
    (row,) = (line for line in written("t/{name}/f -> `{name}` | f\n_ = _", ("t/a_b/f", 1, "1", {})) if "a_b" in line)
    assert row == "| `a_b` | 1 |"


def test_a_cell_may_be_a_text_with_other_keys_of_its_figure():
    figures = [
        ("peers/slow/lag: euler/mm", 4.729, "mm", {"version": "1.2", "reason": "of first order"}),
        ("peers/gone/measured", 0.0, "1", {"error": "no such package"}),
        ("peers/flockstep/lag: euler/mm", 1.0, "mm", {"version": "0.1", "reason": ""}),
    ]
    spec = (
        "peers/{peer:(?!flock)[^/]+}/{mode}/mm -> {peer} {version}, {mode} | away | 2\n"
        "peers/{peer:(?!flock)[^/]+}/{mode}/mm -> {peer} {version}, {mode} | because | {reason}\n"
        "peers/{peer}/measured -> {peer} | away | not measured: {error}\n"
    )
    assert written(spec, *figures)[3:] == [
        "| slow 1.2, lag: euler | 4.7 mm | of first order |",
        "| gone | not measured: no such package |  |",
    ]


def test_a_source_names_the_commits_of_parts_and_the_remark():
    board = result(parts=[{"what": "race and race_unseen", "commit": "f" * 40}], remark="By old code.")
    assert table.source(board) == f"{SOURCE}, race and race_unseen: fffffff. By old code."


def test_a_line_that_is_none_is_refused():
    with refused(SystemExit, "race/step"):
        table.tables("race/step\n", {})


def test_a_document_changes_only_where_its_comments_say_so():
    spec = "<!-- table\nt/f -> f | value\n-->\n"
    text = f"before\n{spec}old\n<!-- end of table -->\nafter <!-- tried moves -->?<!-- /tried --> that\n"
    trials = {"moves": {"count": 1500, "unit": "moves", "remark": "by old code"}}
    made = table.document(text, {"t": result([("t/f", 1.0, "1", {})])}, trials)
    assert made.startswith(
        f"before\n{spec}{SOURCE}\n\n|  | value |\n|---|---:|\n| f | 1 |\n<!-- end of table -->\nafter"
    )
    assert made.endswith("<!-- tried moves -->1,500 moves (by old code)<!-- /tried --> that\n")
    assert table.document(made, {"t": result([("t/f", 1.0, "1", {})])}, trials) == made
    assert "Not measured yet." in table.document(text, {}, {}) and "-->not yet<!--" in table.document(text, {}, {})


def test_a_figure_stands_in_a_sentence():
    text = "in <!-- figure t/seed{}/f as .1% -->?<!-- /figure --> of them"
    seeds = result([(f"t/seed{seed}/f", value, "1", {}) for seed, value in enumerate((0.5, 0.25, 1.0))])
    assert table.document(text, {"t": seeds}, {}).endswith("-->50.0 (25.0 to 100.0) %<!-- /figure --> of them")
    assert "-->not measured yet<!--" in table.document(text, {}, {})
    median = table.document(text.replace("as .1%", "as median .0%"), {"t": seeds}, {})
    assert median.endswith("-->50 %<!-- /figure --> of them")


def test_a_chart_is_shown_once_it_is_drawn():
    def written(name):
        return table.document(f"<!-- chart {name} as Drones -->\nold\n<!-- end of chart -->", {}, {}).splitlines()[1]

    assert written("speed-drones") == "![Drones](../images/speed-drones.svg)"
    assert written("speed-nothing") == "Not measured yet."


def test_all_marks_of_the_documents_are_complete():
    for path in (table.ROOT / "README.md", *(table.ROOT / "docs").rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        assert text.count("<!-- table") == text.count("<!-- end of table -->") == len(table.TABLE.findall(text)), path
        assert text.count("<!-- chart") == text.count("<!-- end of chart") == len(table.CHART.findall(text)), path
        assert text.count("<!-- tried ") == len(table.TRIED.findall(text)), path
        assert text.count("<!-- figure ") == len(table.FIGURE.findall(text)), path
        assert "\n<!-- figure " not in text, f"{path}: a line that begins with a comment ends the paragraph"
        assert "Not measured yet." not in text and "not measured yet" not in text, path


def test_kept_results_have_a_line_for_each_figure_and_a_file_for_readers(tmp_path):
    for path in sorted(table.KEPT.rglob("*.json")):
        assert path.read_text() == table.lines_of(json.loads(path.read_text())), path.name
    assert table.TRIALS.read_text() == table.trials_text(table.read_trials())
    results = table.read(table.KEPT)
    table.write_csv(tmp_path, results)
    assert {path.stem for path in tmp_path.iterdir()} == set(results)
    for name, kept in results.items():
        with (tmp_path / f"{name}.csv").open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert [(row["name"], row["value"]) for row in rows] == [(f["name"], str(f["value"])) for f in kept["figures"]]
        assert all({row[key] for row in rows} == {kept[key]} for key in ("commit", "source") if key in kept)
        assert {row["cpu"] for row in rows} == {kept["machine"]["cpu"]}


def test_figures_of_others_stand_only_beside_ours():
    machine = {"cpu": "Old One", "logical_processors": 20}
    figures = [{"name": "book/move/8", "value": 2.5, "unit": "ms"}]
    results = {"book": {"machine": machine, "source": "table 1 of a book", "figures": figures}}
    spec = "# drones\nours/move/{n} -> {n} | time\nbook/move/{n} -> {n} | book\n"
    assert table.tables(spec, results) == "Not measured yet.\n"
    results["ours"] = result([("ours/move/8", 0.5, "ms", {})])
    written = table.tables(spec, results)
    assert written.startswith(f"{SOURCE}\n\nOld One, 20 logical processors: table 1 of a book\n\n")
    assert written.endswith("| drones | time | book |\n|---|---:|---:|\n| 8 | 0.5 ms | 2.5 ms |\n")


def test_a_cell_may_be_the_ratio_to_a_figure_with_the_same_words():
    ours = result([("ours/move/8", 0.5, "ms", {}), ("ours/move/9", 3.0, "ms", {})])
    book = {"machine": {"cpu": "Old One", "logical_processors": 20}, "source": "a book"}
    results = {"ours": ours, "book": book | {"figures": [{"name": "book/8/move", "value": 2.0, "unit": "ms"}]}}
    lines = table.tables("ours/move/{n} over book/{n}/move -> {n} | times |\n", results).splitlines()
    assert lines[0] == SOURCE and lines[2:] == ["|  | times |", "|---|---:|", "| 8 | 0.25 |"]


def test_a_table_names_only_the_parts_of_its_figures():
    parts = [{"what": "race and dodge", "commit": "f" * 40}]
    figures = [("board/race/s", 1.0, "s", {}), ("board/hover/s", 2.0, "s", {})]
    assert written("board/hover/s -> hover | s\n", *figures, parts=parts)[0] == SOURCE
    assert written("board/{x}/s -> {x} | s\n", *figures, parts=parts)[0] == f"{SOURCE}, race and dodge: fffffff"


def test_charts_are_drawn_if_their_points_change(tmp_path):
    results = {"step": result([(f"step/n{n}/steps_per_second", 1000.0 * n, "1/s", {}) for n in (1, 16)])}
    results["scaling"] = result([(f"scaling/steps_per_second/lidar4096/threads{n}", n, "1/s", {}) for n in (1, 2)])
    with pytest.raises(SystemExit, match=r"speed-drones\.svg: its figures are out of date"):
        charts.draw(results, tmp_path, is_check=True)
    charts.draw(results, tmp_path, is_check=False)
    charts.draw(results, tmp_path, is_check=True)
    drawn = (tmp_path / "speed-drones.svg").read_text(encoding="utf-8")
    assert "steps of the LiDAR task" in drawn and charts.PAPER in drawn and drawn.count("var(--ink)") > 5
    assert "prefers-color-scheme:dark" in drawn
    results["step"]["figures"][0]["value"] = 2.0
    with pytest.raises(SystemExit, match=r"speed-drones\.svg"):
        charts.draw(results, tmp_path, is_check=True)


@pytest.fixture
def history(tmp_path, monkeypatch):
    """A repository with two commits as the checkout of the tables; returns their hashes."""

    def git(*args):
        identity = ["-c", "user.name=n", "-c", "user.email=e"]
        done = subprocess.run(["git", "-C", tmp_path, *identity, *args], check=True, stdout=subprocess.PIPE, text=True)
        return done.stdout.strip()

    git("init", "-q")
    hashes = []
    for _ in range(2):
        git("commit", "-q", "--allow-empty", "-m", "m")
        hashes.append(git("rev-parse", "HEAD"))
    git("checkout", "-q", hashes[0])  # the second is known, but not in the history
    monkeypatch.setattr(table, "ROOT", tmp_path)
    return hashes


def test_commits_that_the_history_lacks_are_refused(history):
    first, second = history
    table.refuse_unknown_sources({"train": result(commit=first)})
    for lost in (second, COMMIT):
        with refused(SystemExit, "train", lost):
            table.refuse_unknown_sources({"train": result(commit=lost, remark="By old code.")})
        trial = {"cpu": "Fast One", "commit": first, "parts": [{"commit": first}, {"commit": lost}]}
        with refused(SystemExit, "pushes", lost):
            table.refuse_unknown_sources({"pushes": trial})


def test_a_shallow_clone_and_a_folder_without_git_know_no_commits(history, tmp_path, monkeypatch):
    shallow = tmp_path / "shallow"
    subprocess.run(["git", "clone", "-q", "--depth=1", f"file://{tmp_path}", shallow], check=True)
    (tmp_path / "archive").mkdir()  # unpacked within a repository
    for folder in (shallow, tmp_path / "archive", "/"):
        monkeypatch.setattr(table, "ROOT", folder)
        table.refuse_unknown_sources({"train": result()})


@pytest.mark.parametrize(
    ("changes", "got"),
    [
        ({"commit": COMMIT + "-dirty"}, COMMIT + "-dirty"),
        ({"commit": "unknown"}, "unknown"),
        ({"commit": [COMMIT, COMMIT]}, [COMMIT, COMMIT]),
        ({"machine": {}}, None),
        ({"machine": MACHINE | {"cpu": ["Fast One", "Slow One"]}}, ["Fast One", "Slow One"]),
    ],
)
def test_figures_of_no_or_several_sources_are_refused(changes, got, monkeypatch):
    monkeypatch.setattr(table, "may_be_in_history", lambda commit: True)
    table.refuse_unknown_sources({"train": result(), "book": {"source": "a table of a book"}})
    with refused(SystemExit, "train", got):
        table.refuse_unknown_sources({"train": result(**changes)})


def test_a_median_keeps_the_least_and_the_greatest_through_products_and_quotients():
    seconds = timing.Median([2.0, 8.0, 4.0])
    made = timing.figure("rate", 16 / seconds, "1/s", 3, mode="fast")
    assert made == {"name": "rate", "value": 4, "unit": "1/s", "runs": 3, "least": 2, "greatest": 8, "mode": "fast"}
    assert list(made) == ["name", "value", "unit", "runs", "least", "greatest", "mode"]
    made = timing.figure("time", 1e6 * seconds / 2, "us", 3)
    assert (made["value"], made["least"], made["greatest"]) == (2e6, 1e6, 4e6)
    ratio = timing.median_ratio([1.0, 4.0, 3.0], [2.0, 2.0, 1.0])
    assert (ratio, ratio.least, ratio.greatest) == (2, 0.5, 3)


def test_a_single_value_has_no_spread():
    assert timing.figure("count", 12345.6, "1", 1) == {"name": "count", "value": 12350, "unit": "1", "runs": 1}
