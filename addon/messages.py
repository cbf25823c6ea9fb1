# SPDX-License-Identifier: GPL-3.0-or-later
"""What a sync or a render has to tell the user: each sentence once, in order."""

from __future__ import annotations

SEVERITIES = ("INFO", "WARNING", "ERROR")


class Messages:
    """An ordered set of (severity, text); a text names the thing, what is wrong, and what is shown
    instead."""

    def __init__(self):
        self._entries: dict[str, str] = {}
        self._topics: dict[str, str] = {}

    def info(self, text: str):
        self._entries.setdefault(text, "INFO")

    def warn(self, text: str, topic: str = ""):
        """`topic` is what the panels offer a remedy for: NODE (cannot be read) or IMAGE (has no pixels)."""
        self._entries.setdefault(text, "WARNING")
        if topic:
            self._topics[text] = topic

    def error(self, text: str):
        self._entries.setdefault(text, "ERROR")

    def extend(self, other: Messages):
        for text, severity in other._entries.items():
            self._entries.setdefault(text, severity)
        self._topics.update(other._topics)

    def replace(self, old: Messages, new: Messages):
        """Takes back what `old` said, then says what `new` says."""
        for text in old._entries:
            self._entries.pop(text, None)
        self.extend(new)

    def about(self, topic: str) -> list[str]:
        return [text for text in self._entries if self._topics.get(text) == topic]

    def clear(self):
        self._entries.clear()

    def __iter__(self):
        return ((severity, text) for text, severity in self._entries.items())

    def __len__(self):
        return len(self._entries)

    def texts(self) -> list[str]:
        return list(self._entries)
