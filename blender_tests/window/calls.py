# SPDX-License-Identifier: GPL-3.0-or-later
"""Times of what Blender's user interface calls in the add-on; long calls are told part by part in the log."""

import gc
import resource
import time

import bpy
import numpy as np

# On the clock; with the waits for a sampler and a picture a call takes up to 35 ms.
LONG_CALL_MS = 40.0
# Of the processor's time, waits being none of it.
BUSY_CALL_MS = 15.0


class Instant:
    """The clock, this thread's processor time, and what it was interrupted by."""

    def __init__(self):
        usage = resource.getrusage(resource.RUSAGE_THREAD)
        self.page_faults, self.preempted = usage.ru_minflt + usage.ru_majflt, usage.ru_nivcsw
        self.clock, self.processor = 1000 * time.perf_counter(), 1000 * time.thread_time()

    def since(self, name: str) -> str:
        now = Instant()
        return (
            f"{name}: {now.clock - self.clock:.1f} ms, {now.processor - self.processor:.1f} processor; "
            f"{now.page_faults - self.page_faults} page faults, {now.preempted - self.preempted} preemptions"
        )


class Calls:
    """Times functions of the add-on that Blender's user interface calls: on the clock, and processor time."""

    def __init__(self):
        self.clock: dict[str, list[float]] = {}
        self.processor: dict[str, list[float]] = {}
        self._replaced = []
        self._parts: list[str] | None = None  # of the call that is going on, inner ones first
        self._collection = Instant()
        self._yardstick = Yardstick()
        gc.callbacks.append(self._collect)
        self._timer = self._rest  # one object, to be found again
        bpy.app.timers.register(self._timer, persistent=True)

    def time(self, holder, name: str, label: str):
        original = getattr(holder, name)

        def timed(*arguments, **options):
            self._parts, started = [], Instant()
            try:
                return original(*arguments, **options)
            finally:
                self._end(label, started)

        self._replace(holder, name, timed)

    def part(self, holder, name: str):
        """A function to be told of in the log when a timed one that calls it took long."""
        original = getattr(holder, name)

        def told(*arguments, **options):
            started = Instant()
            try:
                return original(*arguments, **options)
            finally:
                if self._parts is not None:
                    self._parts.append(started.since(name))

        self._replace(holder, name, told)

    def forget(self):
        self.clock.clear()
        self.processor.clear()
        self._yardstick.longest = 0.0

    def restore(self):
        bpy.app.timers.unregister(self._timer)
        gc.callbacks.remove(self._collect)
        for holder, name, original in reversed(self._replaced):
            setattr(holder, name, original)

    def tell(self, w, prefix: str):
        for label, times in self.clock.items():
            used = self.processor[label]
            w.figure(f"{prefix}{label}, {len(times)} calls, median ms on the clock", np.median(times))
            w.figure(f"{prefix}{label}, longest ms on the clock", max(times))
            w.figure(f"{prefix}{label}, longest ms of processor time", max(used))
        w.figure(f"{prefix}the machine: {Yardstick.PAGES} pages, longest ms", self._yardstick.longest)

    def _replace(self, holder, name: str, function):
        self._replaced.append((holder, name, getattr(holder, name)))
        setattr(holder, name, function)

    def _end(self, label: str, started: Instant):
        ended = Instant()
        clock, processor = ended.clock - started.clock, ended.processor - started.processor
        if clock > LONG_CALL_MS or processor > BUSY_CALL_MS:
            print("Long call:", *self._parts, started.since(label), sep="\n  ", flush=True)
        self._parts = None
        self.clock.setdefault(label, []).append(clock)
        self.processor.setdefault(label, []).append(processor)

    def _collect(self, phase: str, info: dict):
        if phase == "start":
            self._collection = Instant()
        elif self._parts is not None:
            self._parts.append(self._collection.since(f"garbage collection {info['generation']}"))

    def _rest(self) -> float:
        """Sleeps as Blender's main loop does between its rounds. With --enable-event-simulate it does not,
        and what it burns then would be counted as ours and be missing to the threads that build."""
        self._yardstick.measure()
        time.sleep(0.005)
        return 0.0


class Yardstick:
    """Processor time of the same little work again and again: a byte of each of some pages of memory, all of
    them there. Where a hypervisor sets up its page tables anew, it takes hundreds of times as long, and so
    does everything else then."""

    PAGES = 500

    def __init__(self):
        self._pages = np.ones(4096 * self.PAGES, np.uint8)
        self.longest = 0.0

    def measure(self):
        started = Instant()
        self._pages[::4096] += 1
        took = Instant().processor - started.processor
        if took > 1.0:
            print(started.since("Long look at pages that are there"), flush=True)
        self.longest = max(self.longest, took)
