# SPDX-License-Identifier: GPL-3.0-or-later
"""Two ways of sampling side by side: in the view, and as a report on disk."""
