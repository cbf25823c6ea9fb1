# SPDX-License-Identifier: GPL-3.0-or-later
"""A renderer in a process of its own that takes orders, so that renderers can take turns within one run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections import deque
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "demo"))
from blender_process import clean_environment  # noqa: E402


class WorkerError(Exception):
    """The renderer failed; the message has the reason and the end of its log."""


class Worker:
    """Starts `python script JOB.json FD`; `ready` is its first answer. Close it, or use it in a `with`.

    The user folder is empty and goes away afterwards, so no preferences or add-ons of the user play a part.
    """

    def __init__(self, python: Path, script: Path, job: dict, log: Path, **variables: str) -> None:
        self.name, self.log = script.stem, log
        self.user_folder = tempfile.TemporaryDirectory(prefix="peer-user-", dir=log.parent)
        orders_read, orders_write = os.pipe()
        answers_read, answers_write = os.pipe()
        job_file = Path(self.user_folder.name) / "job.json"
        job_file.write_text(json.dumps({**job, "orders": orders_read}))
        with log.open("w") as output:
            self.process = subprocess.Popen(
                [str(python), str(script), str(job_file), str(answers_write)],
                env={**clean_environment(), "BLENDER_USER_RESOURCES": self.user_folder.name, **variables},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                pass_fds=[orders_read, answers_write],
            )
        os.close(orders_read)
        os.close(answers_write)
        self.orders, self.answers = os.fdopen(orders_write, "w", buffering=1), os.fdopen(answers_read)
        self.ready = self._answer()

    def order(self, **order) -> dict:
        """Sends an order and waits for its answer."""
        self.orders.write(json.dumps(order) + "\n")
        return self._answer()

    def _answer(self) -> dict:
        line = self.answers.readline()
        told = json.loads(line) if line else {"event": "failed", "message": "it ended without a word"}
        if told["event"] == "failed":
            tail = "".join(deque(self.log.open(errors="replace"), maxlen=12))
            raise WorkerError(f"{self.name}: {told['message']}\n{tail}The whole log: {self.log}")
        return told

    def close(self) -> None:
        self.orders.close()
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.answers.close()
        self.user_folder.cleanup()

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_) -> None:
        self.close()
