# SPDX-License-Identifier: GPL-3.0-or-later
"""Keeps a native scene equal to a depsgraph: all of it, or what changed."""
