# SPDX-License-Identifier: GPL-3.0-or-later
"""Samplers of the related work, below a heading of their own in menus; docs/related.md explains them."""

TEACHING = "For Comparison and Teaching"
RELATED = (
    ("MEDIAN_CUT", "Median Cut", "Regions of equal power, each cut along its longer side (Debevec 2005)"),
    (
        "HIERARCHY",
        "Hierarchical",
        "A pyramid of sums over all texels, descended level by level (McCool 1997)",
    ),
    (
        "RESAMPLED",
        "Resampled Product",
        "Of several candidates by kd-tree and material the one is kept that brings most light (Burke 2005): "
        "fewer wasted rays, no gain at many samples",
    ),
    (
        "FILTERED",
        "Filtered (biased)",
        "Blurred maps looked up along reflected rays alone (Krivanek and Colbert 2008): little noise, but "
        "the picture stays blurred however many samples are taken",
    ),
)
