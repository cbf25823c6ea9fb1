# SPDX-License-Identifier: GPL-3.0-or-later
"""Node trees: links, constants, coordinates; materials as closures."""
