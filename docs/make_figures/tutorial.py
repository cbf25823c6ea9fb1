# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs the code of text/tutorial_page.md block by block, as a notebook would, and writes docs/tutorial.md
with what it printed; the pictures are those that the code saves."""

from __future__ import annotations

import contextlib
import io
import os
import re
from pathlib import Path

import matplotlib.pyplot as plt
import pages
from context import Context

TITLE = "Tutorial"
INPUTS = ("text/tutorial_page.md", "pages.py")
CODE = re.compile(r"```python\n(.*?)```\n", re.S)


def make(context: Context) -> None:
    text = (Path(__file__).parent / "text" / "tutorial_page.md").read_text()
    entry = context.maps.named("uffizi")
    text = text.replace("{{map}}", entry.name).replace("{{credit}}", entry.credit)
    context.expect(len(CODE.findall(text)))
    names: dict = {}

    def run(match: re.Match) -> str:
        # Readers put their own map there.
        source = match[1].replace('"my_map.hdr"', repr(str(entry.file)))
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.chdir(context.out):
            exec(compile(source, "tutorial.md", "exec"), names)
        plt.close("all")
        for name in re.findall(r'savefig\("([^"]+)"', source):
            context.path(name)
        context.step()
        output = printed.getvalue()
        return match[0] + (f"\n```text\n{output}```\n" if output else "")

    text = CODE.sub(run, text)
    page = pages.place(context.out, "tutorial.md")
    text = text.replace("](figures/", f"]({os.path.relpath(context.out, page.parent)}/")
    context.path(os.path.relpath(page, context.out)).write_text(text)
