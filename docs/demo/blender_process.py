# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs a script in a headless Blender of its own user folder and yields what the script tells."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path


class BlenderError(Exception):
    """Blender failed; the message has the reason and the end of its log."""


def run_in_blender(blender: list[str], script: Path, job: dict, log: Path) -> Iterator[dict]:
    """Starts `blender script JOB.json FD` and yields each JSON object that the script writes to the
    descriptor FD.

    `blender` is the command before the script: a Python that has bpy, or a Blender with its options. The user
    folder is empty and goes away afterwards, so no preferences or add-ons of the user play a part. What
    Blender prints goes to log. An object whose `event` is `failed`, or an exit code, raises BlenderError.
    """
    failure = None
    with (
        tempfile.TemporaryDirectory(prefix="blender-user-", dir=log.parent) as user_folder,
        log.open("w") as output,
    ):
        job_file = Path(user_folder) / "job.json"
        job_file.write_text(json.dumps(job))
        read_end, write_end = os.pipe()
        process = subprocess.Popen(
            [
                *blender,
                str(script),
                *(["--"] if "--python" in blender else []),
                str(job_file),
                str(write_end),
            ],
            env={
                **clean_environment(),
                "BLENDER_USER_RESOURCES": user_folder,
                "BLENDER_USER_SCRIPTS": f"{user_folder}/scripts",  # what 3.4 knows
            },
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            pass_fds=[write_end],
        )
        os.close(write_end)
        try:
            with os.fdopen(read_end) as pipe:
                for line in pipe:
                    told = json.loads(line)
                    if told["event"] == "failed":
                        failure = told["message"]
                        break
                    yield told
            code = process.wait()
        finally:
            with suppress(ProcessLookupError):
                process.kill()
            process.wait()
    if failure or code:
        tail = "".join(deque(log.open(errors="replace"), maxlen=12))
        raise BlenderError(f"Blender: {failure or f'ended with code {code}'}\n{tail}The whole log: {log}")


def clean_environment() -> dict[str, str]:
    """Ours without what would lead Blender's Python to this environment's packages."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV", "BLENDER_"))}
    # Debian's Blender looks for its packages beside the first python3 on PATH.
    return kept | {"PATH": f"/usr/bin:{kept.get('PATH', '')}"}
