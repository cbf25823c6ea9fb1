# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages whose numbers come out of tables: text/NAME.md with references becomes docs/results.md.

    [[table.csv|column=value,column=value|column|format]]   the number in that row, linked to its table
    [[rows table.csv|column:format,column as Title:format]] the table itself
    [[rows table.csv|column|column=value|else:text]]        the table's rows of that value, or the text
    {{uffizi}}                                              the map of that name, or what stands in for it

A number is a link to the CSV that has it; a format is Python's, such as .1f or .0%.
"""

from __future__ import annotations

import csv
import functools
import os
import re
from collections.abc import Callable
from pathlib import Path

from maps import STAND_INS, Maps

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = re.compile(r"\[\[(.*?)\]\]", re.S)
STAND_IN_NOTE = """
> These figures were made without the paper's maps, which are not on this machine: other maps stand in for
> uffizi and doge2. The numbers are those of the stand-ins; the words were written for the paper's maps.
"""


class PageError(Exception):
    """A text refers to something that no table has; the message says what."""


class MissingError(PageError):
    """The table or the picture has not been made."""


def write(texts: Path, out: Path, figures: tuple[str, ...], maps: Maps) -> tuple[Path, list[str]]:
    """Writes results.md from the texts of all figures; returns it and the names of those left out, as a
    table or a picture has not been made yet."""
    page = place(out, "results.md")
    link = os.path.relpath(out, page.parent)
    parts, missing = [], []
    for name in ("results", *figures, "results_end"):
        if not (texts / f"{name}.md").exists():
            continue
        try:
            part = fill((texts / f"{name}.md").read_text(), out, link, maps.named)
            _check_links(part, out, link)
            parts.append(part)
        except MissingError:
            missing.append(name)
    text = "\n".join(parts)
    if not maps.has_the_papers:
        text = text.replace("\n", f"\n{STAND_IN_NOTE}", 1)
    page.write_text(text)
    return page, missing


def _check_links(text: str, out: Path, link: str) -> None:
    for name in re.findall(rf"\]\({re.escape(link)}/([^)]+)\)", text):
        if not (out / name).exists():
            raise MissingError(f"there is no {out / name}; run the command without --only")


def place(out: Path, name: str) -> Path:
    """Where a page lies: beside docs/figures, or in any other folder of figures."""
    return (out.parent if out == ROOT / "docs" / "figures" else out) / name


def fill(text: str, out: Path, link: str, named: Callable | None = None) -> str:
    """The text with every reference replaced; `link` leads from the page to the folder of tables."""
    for name in STAND_INS:
        text = text.replace(f"{{{{{name}}}}}", named(name).name if named else name)
    text = text.replace("](figures/", f"]({link}/")
    return REFERENCE.sub(lambda match: _value(match[1], out, link), text)


def _value(reference: str, out: Path, link: str) -> str:
    parts = [part.strip() for part in reference.split("|")]
    if parts[0].startswith("rows "):
        return _rows(parts[0].removeprefix("rows ").strip(), parts[1], parts[2:], out, link)
    if len(parts) != 4:
        raise PageError(f"[[{reference}]] needs table|row|column|format")
    name, row, column, form = parts
    found = [entry for entry in read_table(out / name) if _matches(entry, row)]
    if len(found) != 1 or column not in found[0]:
        raise PageError(
            f"[[{reference}]]: {len(found)} rows match, columns are {', '.join(found[0]) if found else '-'}"
        )
    return f"[{_format(found[0][column], form)}]({link}/{name})"


def _rows(name: str, columns: str, conditions: list[str], out: Path, link: str) -> str:
    wanted = []
    for column in columns.split(","):
        field, _, form = column.strip().partition(":")
        field, _, title = field.partition(" as ")
        wanted.append((field.strip(), title.strip() or field.strip(), form))
    otherwise = [entry.removeprefix("else:") for entry in conditions if entry.startswith("else:")]
    conditions = [entry for entry in conditions if not entry.startswith("else:")]
    lines = ["| " + " | ".join(title for _, title, _ in wanted) + " |", "|---" * len(wanted) + "|"]
    for entry in read_table(out / name):
        if all(_matches(entry, condition) for condition in conditions):
            lines.append("| " + " | ".join(_format(entry[field], form) for field, _, form in wanted) + " |")
    if len(lines) == 2 and otherwise:
        return otherwise[0]
    return "\n".join([*lines, "", f"From [{name}]({link}/{name})."])


def _matches(entry: dict[str, str], row: str) -> bool:
    conditions = [condition.partition("=")[::2] for condition in row.split(",") if condition.strip()]
    return all(entry.get(column.strip()) == value.strip() for column, value in conditions)


def _format(value: str, form: str) -> str:
    return format(float(value), form) if form else value


def read_table(file: Path) -> list[dict[str, str]]:
    if not file.exists():
        raise MissingError(f"there is no {file}; run the command without --only")
    return _read_table(file, file.stat().st_mtime_ns)


@functools.cache
def _read_table(file: Path, _modified: int) -> list[dict[str, str]]:
    with open(file, newline="") as lines:
        return list(csv.DictReader(lines))
