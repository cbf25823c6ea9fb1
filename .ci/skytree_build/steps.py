# SPDX-License-Identifier: GPL-3.0-or-later
"""Running one step of a build: a status line while it runs, a log of its own, its end where it fails."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BUILD, DIST, LOGS = ROOT / "build", ROOT / "dist", ROOT / "build" / "logs"


class BuildError(Exception):
    """A step did not work out; the text says which, why and what to do."""


def relative(path: Path) -> str:
    return str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else str(path)


class StatusLine:
    """One line about a running step: rewritten in place on a terminal, said every half minute elsewhere."""

    PROGRESS = re.compile(r"^\[\s*(\d+)/(\d+)\]|\[\s*(\d+)%\]\s*$")

    def __init__(self, title: str):
        self.title, self.detail, self.fraction = title, "", None
        self.started, self.spoken = time.monotonic(), time.monotonic()
        self.terminal = sys.stdout.isatty()

    def follow(self, line: str) -> None:
        self.detail = line.strip() or self.detail
        if match := self.PROGRESS.search(line.strip()):
            done, total, percent = match.groups()
            self.fraction = int(percent) / 100 if percent else int(done) / max(int(total), 1)

    def show(self) -> None:
        bar = "" if self.fraction is None else f" {self.fraction:4.0%}"
        if self.terminal:
            width = shutil.get_terminal_size().columns - 1
            if self.fraction is not None:
                filled = round(20 * self.fraction)
                bar = " " + "█" * filled + "░" * (20 - filled) + bar
            print(
                "\r\x1b[K" + f"• {self.title}{bar} {self.seconds} s  {self.detail}"[:width],
                end="",
                flush=True,
            )
        elif time.monotonic() - self.spoken > 30:
            self.spoken = time.monotonic()
            print(f"• {self.title} … {self.seconds} s{bar}", flush=True)

    @property
    def seconds(self) -> int:
        return round(time.monotonic() - self.started)

    def close(self, outcome: str = "") -> None:
        start = "\r\x1b[K" if self.terminal else ""
        print(f"{start}• {self.title}: {outcome or 'done'} ({self.seconds} s)", flush=True)


@dataclass
class Finished:
    returncode: int
    log: Path
    command: list[str]

    def tail(self, lines: int = 25) -> str:
        return "\n".join("    " + line for line in self.log.read_text(errors="replace").splitlines()[-lines:])


def run(title: str, command: list, *, check: bool = True, minutes: float = 60, **variables) -> Finished:
    """Runs a step, its output going to a log of its own; with `check` a failure raises BuildError."""
    LOGS.mkdir(parents=True, exist_ok=True)
    log = LOGS / (re.sub(r"[^a-z0-9.]+", "-", title.lower()).strip("-") + ".log")
    command = [str(part) for part in command]
    status = StatusLine(title)
    with open(log, "w") as sink:
        sink.write(f"$ {shlex.join(command)}\n")
        sink.flush()
        try:
            process = subprocess.Popen(
                command,
                cwd=ROOT,
                env=os.environ | {key: str(value) for key, value in variables.items()},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,  # so that a step that hangs is ended with all that it started
            )
        except OSError as error:
            raise BuildError(f"{title}: {command[0]} cannot be started ({error.strerror}).") from None

        def collect():
            for line in process.stdout:
                sink.write(line)
                status.follow(line)

        reader = threading.Thread(target=collect)
        reader.start()
        try:
            while process.poll() is None:
                status.show()
                if status.seconds > 60 * minutes:
                    os.killpg(process.pid, signal.SIGKILL)
                    sink.write(f"ended: it ran longer than {minutes:g} minutes\n")
                time.sleep(0.1)
        except KeyboardInterrupt:
            os.killpg(process.pid, signal.SIGTERM)
            raise
        finally:
            reader.join()
    finished = Finished(process.returncode, log, command)
    status.close("" if process.returncode == 0 else f"failed, exit code {process.returncode}")
    if check and process.returncode:
        raise BuildError(
            f"{title} failed. The end of {relative(log)}:\n{finished.tail()}\nThe whole log: {relative(log)}"
        )
    return finished


@contextlib.contextmanager
def sole_builder() -> Iterator[None]:
    """Two commands started at once must not write the same environment or build folder."""
    BUILD.mkdir(exist_ok=True)
    with open(BUILD / ".lock", "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("• Another build_addon.py is building here: waiting for it", flush=True)
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def content_hash(paths: Iterable[Path], *facts: object) -> str:
    """A digest of the files below `paths` (names and bytes) and of further facts."""
    digest = hashlib.sha256(repr(facts).encode())
    for path in paths:
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file() and "__pycache__" not in file.parts:
                digest.update(relative(file).encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def up_to_date(stamp: Path, digest: str, *products: Path) -> bool:
    return stamp.exists() and stamp.read_text() == digest and all(product.exists() for product in products)
