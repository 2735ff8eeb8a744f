"""Writes the tables of figures in the README and in docs/ from the kept results of `./dev bench`.

python bench/table.py                 from the kept results
python bench/table.py --keep          from out/bench/*.json and out/tried/*.json, which are kept first
python bench/table.py --check         change nothing; exit 1 if a document or a chart differs from the kept results
python bench/table.py --csv FOLDER    write each result to FOLDER/NAME.csv, with all its figures

A table is described by the comment before it, which `<!-- end of table -->` follows:

    <!-- table
    # text of the corner
    race/{kind}_gates/{ticks}_ticks/step -> {ticks} ticks | {kind} | .2f
    open = not solid
    -->

A line with an arrow takes the figures whose whole name matches, for all values of the words in braces: any text
without a slash, or a regular expression after a colon. The figures are those of the result that has the first part of
the name, or the one named before a colon and a space. Behind the arrow are row, column and, if three digits with the
figure's unit are not right, another number of digits, a format of Python, maybe with a unit, or a text with words in
braces, which may also be other keys of the figure. `A over B` in front of the arrow divides each figure of A by the
one of B with the same words in braces. A cell with several figures, such as the results of five seeds, shows their
median, least and greatest. A line with "=" gives the text for a word, "_ = _" keeps underscores. A line with "#" begins
another table; equations before the first one hold for all. Rows that begin with numbers are in their order. Above the
tables stand the processors and commits of the results.

`<!-- tried NAME -->` is followed by the number of trials of `./dev try NAME`, until `<!-- /tried -->`, and
`<!-- figure PATTERN as FORM -->` by the figures of that pattern as in a cell, until `<!-- /figure -->`. A form that
begins with "median" leaves out least and greatest. `<!-- chart NAME as TEXT -->`, on a line of its own, is followed by
that chart of bench/charts.py, once it is drawn, until `<!-- end of chart -->`.

Each result comes from one commit and one processor. Those of a checkout with local changes are rejected, and so are
those of commits that are not in the history, which nobody could measure again; a shallow clone and a folder without git
of its own cannot tell, so there this is not checked. A "remark" is written by hand into the JSON file of a result that
needs an explanation, and shown with its figures; a new measurement has none. Figures of others, such as those of a
publication, have a "source" instead of a commit, and stand only beside ours.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out"
KEPT = ROOT / "bench" / "results"
TRIALS = ROOT / "bench" / "tried.json"
TABLE = re.compile(r"(<!-- table\n(.*?)-->\n).*?(<!-- end of table -->)", re.DOTALL)
TRIED = re.compile(r"(<!-- tried (\w+) -->).*?(<!-- /tried -->)")
FIGURE = re.compile(r"(<!-- figure (.+?) as (.*?) -->).*?(<!-- /figure -->)")
CHART = re.compile(r"(<!-- chart ([\w-]+) as (.*?) -->\n).*?(<!-- end of chart -->)", re.DOTALL)
WORD = re.compile(r"\{(\w*)(?::([^}]*))?\}")

Result = dict[str, Any]
Results = dict[str, Result]
Cells = dict[tuple[str, str], str]
Used = dict[str, set[str]]  # by a result's name, the second words of its figures


def lines_of(result: Result) -> str:
    """Return a result as JSON with a line for each key, and in lists, such as that of the figures, for each element."""
    rows = []
    for key, value in result.items():
        text = json.dumps(value)
        if isinstance(value, list):
            text = "[\n  " + ",\n  ".join(json.dumps(each) for each in value) + "\n ]"
        rows.append(f"{json.dumps(key)}: {text}")
    return "{\n " + ",\n ".join(rows) + "\n}\n"


def read(folder: Path) -> Results:
    """Return the results in a folder by name."""
    results = {path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))}
    for result in results.values():
        if "simd" in result.get("machine", ()):
            result["machine"]["simd"] = result["machine"]["simd"].replace("AVX3", "AVX-512")  # Highway's name
    return results


def read_trials() -> Results:
    """Return the kept results of `./dev try` by name."""
    return json.loads(TRIALS.read_text())  # type: ignore[no-any-return]


def trials_text(trials: Results) -> str:
    """Return the results of `./dev try` as one JSON object, each as `lines_of` writes it."""
    return (
        "{\n" + ",\n".join(f"{json.dumps(name)}: {lines_of(trials[name]).strip()}" for name in sorted(trials)) + "\n}\n"
    )


def refuse_unknown_sources(results: Results) -> None:
    """Exit if any result lacks one known commit, or one known processor."""
    for name, result in results.items():
        if "source" in result:  # figures of others
            continue
        cpu, commit = result.get("machine", result).get("cpu"), result.get("commit")
        if not isinstance(cpu, str) or not cpu:
            sys.exit(f"{name}: expected the name of one processor, got {cpu!r}")
        if not isinstance(commit, str) or not re.fullmatch("[0-9a-f]{40}", commit):
            sys.exit(f"{name}: expected a single commit without local changes, got {commit!r}")
        for each in {commit, *(part["commit"] for part in result.get("parts", ()))}:
            if not may_be_in_history(each):
                sys.exit(f"{name}: expected a commit of this history, got {each}: measure again, or remove it")


def may_be_in_history(commit: str) -> bool:
    """Return False if the checkout's history lacks a commit; True without git, and in a shallow clone that lacks it."""

    def git(*args: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(["git", *args], cwd=ROOT, check=False, capture_output=True, text=True)

    if shutil.which("git") is None:
        return True
    facts = git("rev-parse", "--is-shallow-repository", "--show-toplevel").stdout.split("\n")
    if facts[0] != "false" or Path(facts[1]).resolve() != ROOT.resolve():  # a source archive within another repository
        return True
    return git("merge-base", "--is-ancestor", commit, "HEAD").returncode == 0


def processor_of(result: Result) -> str:
    machine = result["machine"]
    gpu = f"{machine['gpu']}, " if "gpu" in machine else ""
    simd = f", {machine['simd']}" if "simd" in machine else ""
    return f"{gpu}{machine['cpu']}, {machine['logical_processors']} logical processors{simd}"


def source(result: Result, used: Iterable[str] | None = None) -> str:
    """Describe the machine and the commits of a result, or its source; of its parts, only the ones that are used."""
    if "source" in result:
        return f"{processor_of(result)}: {result['source']}"
    shown = [part for part in result.get("parts", ()) if used is None or not {*used}.isdisjoint(part["what"].split())]
    parts = "".join(f", {part['what']}: {part['commit'][:7]}" for part in shown)
    remark = f". {result['remark']}" if "remark" in result else ""
    return f"{processor_of(result)}, commit {result['commit'][:7]}, {result['commit_date']}{parts}{remark}"


def shown(values: list[float], unit: str, form: str) -> str:
    """Return the text of a number, or of several numbers: their median and, in brackets, least and greatest."""
    if form.startswith("median"):
        values, form = [statistics.median(values)], form.removeprefix("median").lstrip()
    kind, _, own_unit = form.partition(" ")
    unit = "%" if kind.endswith("%") else own_unit or {"1": "", "1/s": "", "us": "µs"}.get(unit, unit)

    def text(value: float) -> str:
        if kind and not kind.isdigit():
            return format(value, kind).removesuffix("%")
        rounded = float(f"{value:.{kind or 3}g}")
        return f"{rounded:,.0f}" if rounded == int(rounded) else f"{rounded:,.10f}".rstrip("0")

    number, least, greatest = (text(value) for value in (statistics.median(values), min(values), max(values)))
    spread = f" ({least} to {greatest})" if least != greatest else ""
    return number + spread + ("" if unit in ("", "°") else " ") + unit


def found(pattern: str, results: Results) -> Iterator[tuple[str, dict[str, Any], dict[str, str]]]:
    """Return the figures that a pattern matches, each with the name of its result and what the braces matched."""
    told, _, pattern = pattern.rpartition(": ")
    literal, *rest = WORD.split(pattern)
    regex = re.escape(literal)
    for word, kind, literal in zip(rest[::3], rest[1::3], rest[2::3], strict=True):
        regex += (f"(?P<{word}>" if word else "(?:") + f"{kind or '[^/]+'})" + re.escape(literal)
    name = told or pattern.split("/")[0]
    for figure in results.get(name, {}).get("figures", ()):
        if match := re.fullmatch(regex, figure["name"]):
            yield name, figure, match.groupdict()


def divided(pattern: str, results: Results) -> Iterator[tuple[str, dict[str, Any], dict[str, str]]]:
    """Return the figures of a pattern, or of `A over B` the ratios, each under the name of A's result."""
    above, _, below = pattern.partition(" over ")
    for name, figure, matched in found(above, results):
        if not below:
            yield name, figure, matched
        for _, divisor, _ in found(below.format(**matched), results) if below else ():
            yield name, figure | {"value": figure["value"] / divisor["value"], "unit": "1"}, matched


def pivot(cells: Cells, corner: str) -> str:
    """Return a table of cells by (row, column), in insertion order."""
    rows, columns = (list(dict.fromkeys(key[i] for key in cells)) for i in (0, 1))
    if all(row[:1].isdigit() for row in rows):
        rows.sort(key=lambda row: [int(number) for number in re.findall(r"\d+", row.replace(",", ""))])
    lines = [f"| {corner} | {' | '.join(columns)} |", f"|---|{'---:|' * len(columns)}"]
    for row in rows:
        lines.append(f"| {row} | {' | '.join(cells.get((row, column), '') for column in columns)} |")
    return "\n".join(lines) + "\n"


def cells_of(lines: list[str], words: dict[str, str], results: Results) -> tuple[Cells, Used]:
    """Return the cells that lines with arrows describe, and the parts of results that they come from."""
    cells: Cells = {}
    used: Used = {}
    for line in lines:
        pattern, _, rest = line.partition(" -> ")
        row_of, column_of, form = (*(part.strip() for part in rest.split("|")), "")[:3]
        by_cell: dict[tuple[str, str], list[dict[str, Any]]] = {}
        for name, figure, matched in divided(pattern, results):
            used.setdefault(name, set()).update(figure["name"].split("/")[1:2])
            space = words.get("_", " ")
            told = figure | {word: words.get(text, text.replace("_", space)) for word, text in matched.items()}
            by_cell.setdefault((row_of.format(**told), column_of.format(**told)), []).append(told)
        for (row, column), figures in by_cell.items():
            values = [figure["value"] for figure in figures]
            is_text = "{" in form
            cells[row, column] = form.format(**figures[0]) if is_text else shown(values, figures[0]["unit"], form)
    return cells, used


def tables(spec: str, results: Results) -> str:
    """Return the tables that a comment describes, with their sources."""
    parts: list[tuple[str, list[str], dict[str, str]]] = [("", [], {})]
    for line in spec.splitlines():
        if line.startswith("#"):
            parts.append((line[1:].strip(), [], dict(parts[0][2])))
        elif " -> " in line:
            parts[-1][1].append(line)
        elif " = " in line:
            key, _, text = line.partition(" = ")
            parts[-1][2][key] = text
        else:
            sys.exit(f"expected '# corner', 'figures -> row | column' or 'word = text', got {line!r}")
    written: list[str] = []
    used: Used = {}
    for corner, lines, words in parts:
        cells, of_table = cells_of(lines, words, results)
        for name, which in of_table.items():
            used.setdefault(name, set()).update(which)
        if cells:
            written.append(pivot(cells, corner))
    if all("source" in results[name] for name in used):  # or there is none
        return "Not measured yet.\n"
    sources = dict.fromkeys(source(results[name], which) + "\n" for name, which in used.items())
    written.insert(0, "\n".join(sources))
    return "\n".join(written)


def document(text: str, results: Results, trials: Results, images: str = "../images") -> str:
    """Return a document with its tables, its figures, its charts in a folder and its numbers of trials."""

    def count(match: re.Match[str]) -> str:
        if (trial := trials.get(match[2])) is None:
            return f"{match[1]}not yet{match[3]}"
        remark = f" ({trial['remark']})" if "remark" in trial else ""
        return f"{match[1]}{trial['count']:,} {trial['unit']}{remark}{match[3]}"

    def figure(match: re.Match[str]) -> str:
        figures = [each for _, each, _ in found(match[2], results)]
        if not figures:
            return f"{match[1]}not measured yet{match[4]}"
        values = [each["value"] for each in figures]
        return f"{match[1]}{shown(values, figures[0]['unit'], match[3])}{match[4]}"

    def chart(match: re.Match[str]) -> str:
        is_drawn = (ROOT / "docs" / "images" / f"{match[2]}.svg").exists()
        shown = f"![{match[3]}]({images}/{match[2]}.svg)" if is_drawn else "Not measured yet."
        return f"{match[1]}{shown}\n{match[4]}"

    text = CHART.sub(chart, FIGURE.sub(figure, text))
    written = TABLE.sub(lambda m: f"{m[1]}{tables(m[2], results)}{m[3]}", text)
    return TRIED.sub(count, written)


def write_csv(folder: Path, results: Results) -> None:
    """Write a file with all figures of each result."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, result in results.items():
        about = {key: result[key] for key in ("commit", "commit_date", "source") if key in result} | result["machine"]
        keys = dict.fromkeys([*(key for figure in result["figures"] for key in figure if key != "curve"), *about])
        with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            rows = csv.DictWriter(file, list(keys), extrasaction="ignore", lineterminator="\n")
            rows.writeheader()
            rows.writerows(figure | about for figure in result["figures"])


def keep() -> None:
    """Copy new results to the committed ones."""
    fresh, tried = sorted((OUT / "bench").glob("*.json")), read(OUT / "tried")
    if not fresh and not tried:
        sys.exit(f"{OUT}/bench: no results; run ./dev bench first")
    refuse_unknown_sources(read(OUT / "bench"))
    refuse_unknown_sources(tried)
    for path in fresh:
        shutil.copy(path, KEPT / path.name)
    if tried:
        TRIALS.write_text(trials_text(read_trials() | tried))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    action = parser.add_mutually_exclusive_group()
    action.add_argument("--keep", action="store_true", help="copy new results to bench/results/ first")
    action.add_argument("--check", action="store_true", help="change nothing; exit 1 if a file is out of date")
    action.add_argument("--csv", type=Path, metavar="FOLDER", help="write only a CSV file of each result")
    args = parser.parse_args()
    if args.keep:
        keep()
    results, trials = read(KEPT), read_trials()
    if args.csv:
        write_csv(args.csv, results)
        return
    refuse_unknown_sources(results)
    refuse_unknown_sources(trials)
    sys.path.append(str(Path(__file__).parent))  # not there after `python -m bench.table`
    import charts  # imports matplotlib

    charts.draw(results, ROOT / "docs" / "images", args.check)
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))):
        text = path.read_text(encoding="utf-8")
        images = os.path.relpath(ROOT / "docs" / "images", path.parent)
        if (written := document(text, results, trials, images)) == text:
            continue
        if args.check:
            sys.exit(f"{path.name}: its figures are out of date: run python bench/table.py")
        path.write_text(written, encoding="utf-8")


if __name__ == "__main__":
    main()
