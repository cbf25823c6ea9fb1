# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender's colour and converter nodes compute, for numpy arrays with 1 or 3 channels on the last axis.

The formulas follow Blender's manual (Shader Nodes > Color, Converter) and were checked against Cycles'
pictures.
"""

from __future__ import annotations

import numpy as np

LUMINANCE = np.array((0.2126, 0.7152, 0.0722), np.float32)


def _safe_divide(a, b):
    return np.where(b != 0.0, a / np.where(b != 0.0, b, 1.0), 0.0)


def _safe_power(a, b):
    # A negative base with a fractional exponent has no real power; Blender's nodes give zero there.
    real = (a >= 0.0) | (b == np.floor(b))
    return np.where(real, np.power(np.where(real, a, 0.0), b), 0.0)


def _wrap(value, maximum, minimum):
    span = maximum - minimum
    return np.where(span != 0.0, value - span * np.floor(_safe_divide(value - minimum, span)), minimum)


def _pingpong(value, scale):
    fraction = _safe_divide(value - scale, scale * 2.0)
    return np.where(scale != 0.0, np.abs((fraction - np.floor(fraction)) * scale * 2.0 - scale), 0.0)


MATH = {
    "ADD": lambda a, b, c: a + b,
    "SUBTRACT": lambda a, b, c: a - b,
    "MULTIPLY": lambda a, b, c: a * b,
    "DIVIDE": lambda a, b, c: _safe_divide(a, b),
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b, c: _safe_power(a, b),
    "LOGARITHM": lambda a, b, c: np.where(
        (a > 0) & (b > 0), _safe_divide(np.log(np.maximum(a, 1e-38)), np.log(np.maximum(b, 1e-38))), 0.0
    ),
    "SQRT": lambda a, b, c: np.sqrt(np.maximum(a, 0.0)),
    "INVERSE_SQRT": lambda a, b, c: np.where(a > 0.0, 1.0 / np.sqrt(np.maximum(a, 1e-38)), 0.0),
    "ABSOLUTE": lambda a, b, c: np.abs(a),
    "EXPONENT": lambda a, b, c: np.exp(a),
    "MINIMUM": lambda a, b, c: np.minimum(a, b),
    "MAXIMUM": lambda a, b, c: np.maximum(a, b),
    "LESS_THAN": lambda a, b, c: (a < b) * 1.0,
    "GREATER_THAN": lambda a, b, c: (a > b) * 1.0,
    "SIGN": lambda a, b, c: np.sign(a),
    "COMPARE": lambda a, b, c: (np.abs(a - b) <= np.maximum(c, 1e-5)) * 1.0,
    "ROUND": lambda a, b, c: np.floor(a + 0.5),
    "FLOOR": lambda a, b, c: np.floor(a),
    "CEIL": lambda a, b, c: np.ceil(a),
    "TRUNC": lambda a, b, c: np.trunc(a),
    "FRACT": lambda a, b, c: a - np.floor(a),
    "MODULO": lambda a, b, c: np.where(b != 0.0, np.fmod(a, np.where(b != 0.0, b, 1.0)), 0.0),
    "FLOORED_MODULO": lambda a, b, c: np.where(b != 0.0, np.mod(a, np.where(b != 0.0, b, 1.0)), 0.0),
    "WRAP": _wrap,
    "SNAP": lambda a, b, c: np.floor(_safe_divide(a, b)) * b,
    "PINGPONG": lambda a, b, c: _pingpong(a, b),
    "SINE": lambda a, b, c: np.sin(a),
    "COSINE": lambda a, b, c: np.cos(a),
    "TANGENT": lambda a, b, c: np.tan(a),
    "ARCSINE": lambda a, b, c: np.arcsin(np.clip(a, -1.0, 1.0)),
    "ARCCOSINE": lambda a, b, c: np.arccos(np.clip(a, -1.0, 1.0)),
    "ARCTANGENT": lambda a, b, c: np.arctan(a),
    "ARCTAN2": lambda a, b, c: np.arctan2(a, b),
    "SINH": lambda a, b, c: np.sinh(a),
    "COSH": lambda a, b, c: np.cosh(a),
    "TANH": lambda a, b, c: np.tanh(a),
    "RADIANS": lambda a, b, c: np.radians(a),
    "DEGREES": lambda a, b, c: np.degrees(a),
}


def math(a, b, c, operation: str, use_clamp: bool):
    result = MATH[operation](a, b, c)
    return np.clip(result, 0.0, 1.0) if use_clamp else result


def rgb_to_hsv(rgb):
    maximum, minimum = rgb.max(axis=-1), rgb.min(axis=-1)
    delta = maximum - minimum
    safe = np.where(delta > 0.0, delta, 1.0)
    red, green, blue = ((maximum - rgb[..., i]) / safe for i in range(3))
    hue = np.where(
        rgb[..., 0] == maximum,
        blue - green,
        np.where(rgb[..., 1] == maximum, 2.0 + red - blue, 4.0 + green - red),
    )
    hue = np.where(delta > 0.0, (hue / 6.0) % 1.0, 0.0)
    return np.stack((hue, _safe_divide(delta, maximum), maximum), axis=-1)


def hsv_to_rgb(hsv):
    hue, saturation, value = hsv[..., 0], hsv[..., 1], hsv[..., 2]
    ramps = [
        np.clip(f, 0.0, 1.0)
        for f in (np.abs(hue * 6.0 - 3.0) - 1.0, 2.0 - np.abs(hue * 6.0 - 2.0), 2.0 - np.abs(hue * 6.0 - 4.0))
    ]
    return np.stack([((f - 1.0) * saturation + 1.0) * value for f in ramps], axis=-1)


def _overlay(a, b, t):
    return np.where(a < 0.5, a * (1 - t + 2 * t * b), 1 - (1 - t + 2 * t * (1 - b)) * (1 - a))


def _burn(a, b, t):
    d = 1 - t + t * b
    return np.where(d <= 0.0, 0.0, np.clip(1 - (1 - a) / np.where(d > 0.0, d, 1.0), 0.0, 1.0))


def _dodge(a, b, t):
    d = 1 - t * b
    dodged = np.where(d <= 0.0, 1.0, np.minimum(a / np.where(d > 0.0, d, 1.0), 1.0))
    return np.where(a != 0.0, dodged, 0.0)


def _soft_light(a, b, t):
    screen = 1 - (1 - b) * (1 - a)
    return (1 - t) * a + t * ((1 - a) * b * a + a * screen)


def _hsv_blend(take):
    def blend(a, b, t):
        a, b = np.broadcast_arrays(a, b)
        hsv_a, hsv_b = rgb_to_hsv(a), rgb_to_hsv(b)
        # A grey has no hue to give; only VALUE works without one.
        usable = (hsv_b[..., 1:2] != 0.0) | ("h" not in take)
        mixed = np.stack([(hsv_b if c in take else hsv_a)[..., i] for i, c in enumerate("hsv")], axis=-1)
        return np.where(usable, (1 - t) * a + t * hsv_to_rgb(mixed), a)

    return blend


def _value_or_saturation(index):
    def blend(a, b, t):
        a, b = np.broadcast_arrays(a, b)
        hsv, other = rgb_to_hsv(a), rgb_to_hsv(b)
        mixed = hsv.copy()
        mixed[..., index] = (1 - t[..., 0]) * hsv[..., index] + t[..., 0] * other[..., index]
        return hsv_to_rgb(mixed)

    return blend


BLEND = {
    "MIX": lambda a, b, t: (1 - t) * a + t * b,
    "ADD": lambda a, b, t: a + t * b,
    "MULTIPLY": lambda a, b, t: a * (1 - t + t * b),
    "SUBTRACT": lambda a, b, t: a - t * b,
    "DIVIDE": lambda a, b, t: np.where(b != 0.0, (1 - t) * a + t * _safe_divide(a, b), a),
    "SCREEN": lambda a, b, t: 1 - (1 - t + t * (1 - b)) * (1 - a),
    "DIFFERENCE": lambda a, b, t: (1 - t) * a + t * np.abs(a - b),
    "EXCLUSION": lambda a, b, t: np.maximum((1 - t) * a + t * (a + b - 2 * a * b), 0.0),
    "DARKEN": lambda a, b, t: (1 - t) * a + t * np.minimum(a, b),
    "LIGHTEN": lambda a, b, t: (1 - t) * a + t * np.maximum(a, b),
    "OVERLAY": _overlay,
    "BURN": _burn,
    "DODGE": _dodge,
    "SOFT_LIGHT": _soft_light,
    "LINEAR_LIGHT": lambda a, b, t: a + t * (2 * b - 1),
    "HUE": _hsv_blend("h"),
    "COLOR": _hsv_blend("hs"),
    "SATURATION": _value_or_saturation(1),
    "VALUE": _value_or_saturation(2),
}


def mix(factor, a, b, blend_type: str, clamp_factor: bool, clamp_result: bool):
    t = np.clip(factor, 0.0, 1.0) if clamp_factor else factor
    result = BLEND[blend_type](a, b, t)
    return np.clip(result, 0.0, 1.0) if clamp_result else result


def hue_saturation(hue, saturation, value, factor, color):
    hsv = rgb_to_hsv(color)
    shifted = np.stack(
        (
            (hsv[..., 0] + hue[..., 0] + 0.5) % 1.0,
            np.clip(hsv[..., 1] * saturation[..., 0], 0.0, 1.0),
            hsv[..., 2] * value[..., 0],
        ),
        axis=-1,
    )
    return np.maximum((1 - factor) * color + factor * hsv_to_rgb(shifted), 0.0)


def bright_contrast(color, brightness, contrast):
    return np.maximum((1.0 + contrast) * color + brightness - contrast * 0.5, 0.0)


def map_range(value, from_min, from_max, to_min, to_max, clamp: bool):
    t = _safe_divide(value - from_min, from_max - from_min)
    result = to_min + t * (to_max - to_min)
    return np.clip(result, np.minimum(to_min, to_max), np.maximum(to_min, to_max)) if clamp else result


def color_ramp(factor, table: tuple):
    """`table`: RGB at equal steps over [0, 1]."""
    colors = np.array(table, np.float32)
    steps = np.linspace(0.0, 1.0, len(colors))
    return np.stack([np.interp(factor[..., 0], steps, colors[:, i]) for i in range(3)], axis=-1)


def combine(red, green, blue):
    return np.concatenate(np.broadcast_arrays(red, green, blue), axis=-1)


def channel(color, index: int):
    return color[..., index : index + 1]


def gamma(color, exponent):
    # Blender leaves values that are not positive as they are.
    return np.where(color > 0.0, np.power(np.maximum(color, 0.0), exponent), color)


OPS = {
    "add": lambda a, b: a + b,
    "multiply": lambda a, b: a * b,
    "luminance": lambda a: (a @ LUMINANCE.astype(a.dtype))[..., None],
    "vector_mean": lambda a: a.mean(axis=-1, keepdims=True),
    "math": math,
    "mix": mix,
    "hue_saturation": hue_saturation,
    "bright_contrast": bright_contrast,
    "gamma": gamma,
    "invert": lambda factor, color: (1 - factor) * color + factor * (1 - color),
    "map_range": map_range,
    "clamp": lambda value, low, high: np.minimum(np.maximum(value, low), high),
    "color_ramp": color_ramp,
    "combine": combine,
    "channel": channel,
    "rgb_to_hsv": rgb_to_hsv,
    "hsv_to_rgb": hsv_to_rgb,
}

RESULT_CHANNELS = {
    "luminance": 1,
    "vector_mean": 1,
    "channel": 1,
    "combine": 3,
    "color_ramp": 3,
    "math": 1,
    "rgb_to_hsv": 3,
    "hsv_to_rgb": 3,
    "hue_saturation": 3,
}
