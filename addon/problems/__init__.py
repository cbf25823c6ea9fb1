# SPDX-License-Identifier: GPL-3.0-or-later
"""Warnings with a remedy; baking a world."""
