# SPDX-License-Identifier: GPL-3.0-or-later
"""3D views: one renderer for each region, its clock, the floating preview, drawing on the GPU."""
