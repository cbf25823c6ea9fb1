# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints the polynomial coefficients of kernel/math.h (run by hand; needs numpy only).

Minimax by Lawson's iteration: weighted least squares on a dense Chebyshev grid whose weights grow where the
error is largest (Lawson 1961). Errors are printed relative, in units of 2^-24 (half an ulp just above 1).
"""

import numpy as np


def minimax(f, lo, hi, terms, scale=lambda x: np.ones_like(x), iterations=400):
    """Coefficients c of sum c_k x^k, k < terms, that minimise max |f - p| * scale over [lo, hi]."""
    x = 0.5 * (lo + hi) + 0.5 * (hi - lo) * np.cos(np.linspace(0, np.pi, 4001))
    basis = np.vander(x, terms, increasing=True) * scale(x)[:, None]
    target = f(x) * scale(x)
    weight = np.full_like(x, 1.0 / len(x))
    for _ in range(iterations):
        root = np.sqrt(weight)
        c = np.linalg.lstsq(basis * root[:, None], target * root, rcond=None)[0]
        error = np.abs(basis @ c - target)
        weight *= error + 1e-300
        weight /= weight.sum()
    return c, error.max()


def series(a0, ratio, terms):
    """Sum of terms with a_{k+1} = a_k * ratio(k), a function of x: exact near 0 where closed forms cancel."""

    def f(x):
        total, a, power = np.zeros_like(x), a0, np.ones_like(x)
        for k in range(terms):
            total, power = total + a * power, power * x
            a *= ratio(k)
        return total

    return f


def atan_tail(s):
    """(atan(t)/t - 1)/s with s = t^2 <= tan(pi/8)^2, as a series."""
    return sum((-1) ** (k + 1) / (2 * k + 3) * s**k for k in range(60))


def log_tail(x):
    """(log1p(x) - x + x^2/2)/x^3."""
    near = sum((-1) ** k / (k + 3) * x**k for k in range(24))
    with np.errstate(all="ignore"):
        far = (np.log1p(x) - x + x * x / 2) / x**3
    return np.where(np.abs(x) < 0.1, near, far)


quarter = (np.pi / 4) ** 2
eighth = np.tan(np.pi / 8) ** 2
half_ln2 = np.log(2) / 2
JOBS = {
    "sin: x + x^3 p(x^2)": (
        series(-1 / 6, lambda k: -1 / ((2 * k + 4) * (2 * k + 5)), 12),
        0,
        quarter,
        3,
        lambda s: s,
    ),
    "cos: 1 - x^2/2 + x^4 p(x^2)": (
        series(1 / 24, lambda k: -1 / ((2 * k + 5) * (2 * k + 6)), 12),
        0,
        quarter,
        3,
        lambda s: s * s,
    ),
    "atan: t + t^3 p(t^2)": (atan_tail, 0, eighth, 4, lambda s: s),
    "expm1: x + x^2 p(x)": (
        series(1 / 2, lambda k: 1 / (k + 3), 20),
        -half_ln2,
        half_ln2,
        6,
        lambda x: np.abs(x),
    ),
    "log1p: x - x^2/2 + x^3 p(x)": (log_tail, np.sqrt(0.5) - 1, np.sqrt(2) - 1, 8, lambda x: x * x),
}

if __name__ == "__main__":
    for name, (f, lo, hi, terms, scale) in JOBS.items():
        c, error = minimax(f, lo, hi, terms, scale)
        print(f"{name}   error {error * 2**24:.3f} * 2^-24")
        print("   ", ", ".join(f"{np.float32(v)!s}f" for v in c))
