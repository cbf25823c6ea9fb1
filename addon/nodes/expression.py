# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour expressions of a node tree, evaluated with numpy over whole images.

An expression is a hashable tree, so that it is its own cache key: equal trees give equal pixels. Values have
one channel (scalars) or three (colours, vectors) on their last axis: a constant colour is (3,), an image
(height, width, 3); numpy's broadcasting does the rest. Constant parts are folded when the tree is made.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass

import numpy as np

from . import node_ops

REC709_LUMINANCE = (0.2126, 0.7152, 0.0722)


@dataclass(frozen=True)
class Constant:
    values: tuple[float, ...]


@dataclass(frozen=True)
class Leaf:
    """A field given from outside, such as an image in some coordinates; `channels` is 1 or 3."""

    source: Hashable
    channels: int = 3


@dataclass(frozen=True)
class Call:
    op: str
    args: tuple[Expression, ...]
    settings: tuple = ()


Expression = Constant | Leaf | Call

BLACK = Constant((0.0, 0.0, 0.0))
ONE = Constant((1.0,))


def constant(value) -> Constant:
    """A float or a sequence as a constant; the alpha of a four-component colour is dropped."""
    if np.ndim(value) == 0:
        return Constant((float(value),))
    return Constant(tuple(float(x) for x in value)[:3])


def call(op: str, *args: Expression, settings: tuple = ()) -> Expression:
    """`op` of node_ops applied to `args`; folded to a constant if every argument is one."""
    if op == "multiply" and ONE in args:
        return args[1] if args[0] == ONE else args[0]
    if all(isinstance(arg, Constant) for arg in args):
        arrays = [np.array(arg.values, np.float64) for arg in args]
        return Constant(tuple(float(x) for x in node_ops.OPS[op](*arrays, *settings)))
    return Call(op, args, settings)


def multiply(a: Expression, b: Expression) -> Expression:
    return call("multiply", a, b)


def add(a: Expression, b: Expression) -> Expression:
    if a == BLACK:
        return b
    return a if b == BLACK else call("add", a, b)


def scalar(expression: Expression, is_vector: bool = False) -> Expression:
    """One channel, as an implicit socket conversion gives: luminance of a colour, mean of a vector."""
    if channels(expression) == 1:
        return expression
    return call("vector_mean" if is_vector else "luminance", expression)


def channels(expression: Expression) -> int:
    if isinstance(expression, Constant):
        return len(expression.values)
    if isinstance(expression, Leaf):
        return expression.channels
    fixed = node_ops.RESULT_CHANNELS.get(expression.op)
    return fixed or max(channels(arg) for arg in expression.args)


def rgb(values: Constant) -> tuple[float, float, float]:
    return values.values if len(values.values) == 3 else values.values * 3


def leaves(expression: Expression) -> Iterator[Leaf]:
    if isinstance(expression, Leaf):
        yield expression
    elif isinstance(expression, Call):
        for arg in expression.args:
            yield from leaves(arg)


def replace_leaves(expression: Expression, replacement: Callable[[Leaf], Expression]) -> Expression:
    if isinstance(expression, Leaf):
        return replacement(expression)
    if isinstance(expression, Call):
        return call(
            expression.op,
            *(replace_leaves(arg, replacement) for arg in expression.args),
            settings=expression.settings,
        )
    return expression


def split_scale(expression: Expression) -> tuple[tuple[float, float, float], Expression]:
    """(scale, rest) with expression = scale * rest: the constant factors taken out of products."""
    if isinstance(expression, Constant):
        return rgb(expression), ONE
    scale = np.ones(3)
    while isinstance(expression, Call) and expression.op == "multiply":
        a, b = expression.args
        if isinstance(a, Constant):
            factor, expression = a, b
        elif isinstance(b, Constant):
            factor, expression = b, a
        else:
            break
        scale = scale * factor.values
    return tuple(float(x) for x in scale), expression


def evaluate(expression: Expression, leaf_values: Callable[[Leaf], np.ndarray]) -> np.ndarray:
    """float32 array of the expression; `leaf_values` supplies (height, width, channels) for each leaf."""
    if isinstance(expression, Constant):
        return np.array(expression.values, np.float32)
    if isinstance(expression, Leaf):
        return leaf_values(expression)
    args = [evaluate(arg, leaf_values) for arg in expression.args]
    with np.errstate(all="ignore"):
        return np.asarray(node_ops.OPS[expression.op](*args, *expression.settings), np.float32)
