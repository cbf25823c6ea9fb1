# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the figures' command: a quick run, resuming; each number of results.md stands in its table.

python -m pytest docs/make_figures      (about half a minute, most of it renders)
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))
import make_figures
import pages

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
RESULTS = ROOT / "docs" / "results.md"
LINK = re.compile(r"\[([^\]]+)\]\((figures/[\w.]+\.csv)\)")


def test_references_become_linked_numbers(tmp_path):
    (tmp_path / "t.csv").write_text("map,method,error\nuffizi,a,0.1234\nuffizi,b,0.2\n")
    text = (
        "The error of {{uffizi}} is [[t.csv|map={{uffizi}},method=a|error|.1%]].\n"
        "[[rows t.csv|method,error as E:.2f|method=b]]"
    )
    filled = pages.fill(text, tmp_path, "figures")
    assert "The error of uffizi is [12.3%](figures/t.csv)." in filled
    assert "| method | E |\n|---|---|\n| b | 0.20 |" in filled
    for wrong in (
        "[[t.csv|map=x|error|.1f]]",
        "[[t.csv|map=uffizi|error|.1f]]",
        "[[no.csv|a=b|c|d]]",
        "[[t.csv]]",
    ):
        with pytest.raises(pages.PageError):
            pages.fill(wrong, tmp_path, "figures")


def run_command(out: Path, *options: str) -> str:
    command = [sys.executable, HERE / "make_figures.py", "--quick", "--out", out, *options]
    finished = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    return finished.stdout


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    out = tmp_path_factory.mktemp("figures")
    try:
        run_command(out, "--only", "figure1", "figure2")
    finally:
        yield out
        for name in ("figure1", "figure2"):
            make_figures.stamp_file(name, out).unlink(missing_ok=True)


def tables(out: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in sorted(out.iterdir()) if "_times" not in file.stem}


def test_a_quick_run_makes_pictures_and_tables(quick):
    names = set(tables(quick))
    assert {"figure1.png", "figure1.csv", "figure2.png", "figure2.csv", "figure2_all.png"} <= names
    rows = pages.read_table(quick / "figure1.csv")
    assert {row["criterion"] for row in rows} == {"RANGE", "VARIANCE", "SSE", "MIN_VARIANCE"}
    assert all(int(row["bytes"]) <= 48 * 1024 for row in rows)


def test_what_is_finished_is_skipped_and_what_is_not_gives_the_same(quick):
    before = tables(quick)
    assert run_command(quick, "--only", "figure1", "figure2").count("finished before") == 2
    (quick / "figure2.csv").unlink()  # as after an interruption
    said = run_command(quick, "--only", "figure1", "figure2")
    assert said.count("finished before") == 1
    assert tables(quick) == before


@pytest.mark.skipif("## Figure" not in RESULTS.read_text(), reason="docs/results.md has not been made")
class TestResults:
    def test_every_picture_and_table_exists(self):
        links = re.findall(r"\]\((figures/[^)]+)\)", RESULTS.read_text())
        assert len(links) > 20
        assert not [link for link in links if not (ROOT / "docs" / link).exists()]

    def test_every_linked_number_stands_in_its_table(self):
        linked = [found for found in LINK.findall(RESULTS.read_text()) if found[0][0].isdigit()]
        assert len(linked) > 20
        wrong = []
        for text, table in linked:
            cells = [cell for row in pages.read_table(ROOT / "docs" / table) for cell in row.values()]
            if not any(shows(text, cell) for cell in cells):
                wrong.append((text, table))
        assert not wrong

    def test_every_sentence_with_a_number_links_to_a_table(self):
        bare = []
        for paragraph in re.split(r"\n\s*\n", RESULTS.read_text()):
            if paragraph.startswith((">", "#", "|", "!", "```")):
                continue  # what the paper says, headings, tables, pictures
            for sentence in re.split(r"(?<=[.:;])\s+", paragraph):
                rest = LINK.sub("", sentence)
                rest = re.sub(r"`[^`]*`|\([^()]*\b20\d\d\)|Figures? \d( (and|to) \d)?|equation \d", "", rest)
                if re.search(r"\d", rest) and not LINK.search(sentence):
                    bare.append(sentence)
        assert not bare


def shows(text: str, cell: str) -> bool:
    """Whether the text is the cell's number, rounded."""
    try:
        number, value = float(text.rstrip("%").replace(",", "")), float(cell)
    except ValueError:
        return text == cell
    value *= 100 if text.endswith("%") else 1
    decimals = len(text.rstrip("%").partition(".")[2])
    return round(value, decimals) == number or format(value, f".{decimals}f") == text.rstrip("%")
