# SPDX-License-Identifier: GPL-3.0-or-later
"""The map, its blocks and its pdf as pictures; blocks and samples over the 3D view."""
