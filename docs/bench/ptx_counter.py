# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs small PTX kernels on the processor, one thread at a time, and counts what they execute.

Each kernel becomes a Python function over its basic blocks. Only what the samplers' kernels use is known;
anything else raises NotImplementedError with the line. Float results are exact: float32 operations rounded
from double, which for + - * / and sqrt gives the correctly rounded result.
"""

from __future__ import annotations

import ctypes
import math
import re
import struct
from collections import Counter
from dataclasses import dataclass, field

_SIZES = {"8": 1, "16": 2, "32": 4, "64": 8}
_COMPARE = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}


@dataclass
class Memory:
    """Regions far apart, so that an address names its region; the first bytes of each are at base."""

    regions: list[bytearray] = field(default_factory=list)
    loads: Counter = field(default_factory=Counter)  # region -> loads
    sectors: set = field(default_factory=set)  # 32-byte pieces touched by the present thread

    def add(self, data: bytes) -> int:
        self.regions.append(bytearray(data))
        return len(self.regions) << 40

    def load(self, address: int, kind: str, count: int = 1):
        region, offset = (address >> 40) - 1, address & ((1 << 40) - 1)
        size = struct.calcsize(kind)
        self.loads[region] += 1
        self.sectors.update((region, s) for s in range(offset >> 5, (offset + size * count - 1 >> 5) + 1))
        values = struct.unpack_from(f"<{count}{kind}", self.regions[region], offset)
        return values[0] if count == 1 else values

    def store(self, address: int, kind: str, *values):
        region, offset = (address >> 40) - 1, address & ((1 << 40) - 1)
        struct.pack_into(f"<{len(values)}{kind}", self.regions[region], offset, *values)


def f32(x: float) -> float:
    return ctypes.c_float(x).value


def to_int(x: float, low: int, high: int) -> int:
    if math.isnan(x):
        return 0
    return min(max(int(x) if math.isfinite(x) else (high if x > 0 else low), low), high)


def divide(a: float, b: float) -> float:
    if b == 0 or math.isnan(a) or math.isnan(b):
        invalid = a == 0 or math.isnan(a) or math.isnan(b)
        return math.nan if invalid else math.copysign(math.inf, a) * math.copysign(1, b)
    return f32(a / b)


def f_min(a: float, b: float) -> float:
    return b if math.isnan(a) else a if math.isnan(b) else min(a, b)


def f_max(a: float, b: float) -> float:
    return b if math.isnan(a) else a if math.isnan(b) else max(a, b)


def signed(x: int, bits: int) -> int:
    return x - (1 << bits) if x >> (bits - 1) & 1 else x


def float_bits(x: float) -> int:
    return struct.unpack("<I", struct.pack("<f", x))[0]


def bits_float(x: int) -> float:
    return struct.unpack("<f", struct.pack("<I", x))[0]


class Kernel:
    """One entry of a PTX text. Calling it runs one thread."""

    def __init__(self, ptx: str, name: str):
        found = re.search(r"\.entry " + name + r"\((.*?)\)\s*(?:\.\w+[^{]*)?\{(.*?)\n\}", ptx, re.DOTALL)
        if not found:
            raise KeyError(f"the PTX has no kernel {name}")
        self.source = self._translate(found[2])
        names = {
            "f32": f32, "to_int": to_int, "divide": divide, "f_min": f_min, "f_max": f_max, "signed": signed,
            "float_bits": float_bits, "bits_float": bits_float, "math": math,
        }  # fmt: skip
        exec(compile(self.source, name, "exec"), names)
        self._run = names["kernel"]

    def __call__(self, memory: Memory, param: int, thread: int) -> int:
        """The number of instructions executed; `param` is the address of the parameter struct."""
        memory.sectors.clear()
        return self._run(memory, param, thread)

    def _translate(self, body: str) -> str:
        blocks: list[list[str]] = [[]]
        labels: dict[str, int] = {}
        for line in body.splitlines():
            line = line.strip().rstrip(";")
            if not line or line.startswith((".", "//")):
                continue
            if line.endswith(":"):
                blocks.append([])
                labels[line[:-1]] = len(blocks) - 1
                continue
            blocks[-1].append(line)
            if re.match(r"(@!?%p\d+ )?\s*bra|ret", line):
                blocks.append([])
        lines = ["def kernel(m, param, thread):", " n = 0; block = 0", " while True:"]
        for index, block in enumerate(blocks):
            lines.append(f"  if block == {index}:")
            lines.append(f"   n += {len(block)}")
            for line in block:
                lines.append("   " + self._statement(line, labels))
            lines.append(f"   block = {index + 1}")
        return "\n".join(lines)

    def _statement(self, line: str, labels: dict[str, int]) -> str:
        guard = re.match(r"@(!?)(%p\d+)\s+(.*)", line)
        if guard:
            inner = self._statement(guard[3], labels)
            return f"if {'not ' if guard[1] else ''}{_name(guard[2])}: {inner}"
        op, _, rest = line.partition(" ") if " " in line.split("\t")[0] else line.partition("\t")
        parts = op.strip().split(".")
        if parts[0] == "bra":
            return f"block = {labels[rest.strip()]}; continue"
        if parts[0] == "ret":
            return "return n"
        operands = [o.strip() for o in re.findall(r"\[[^\]]*\]|\{[^}]*\}|[^,\s][^,]*", rest)]
        statement = _memory(parts, operands) or _arithmetic(parts, operands)
        if statement is None:
            raise NotImplementedError(f"PTX instruction {line}")
        return statement


def _name(operand: str) -> str:
    return operand.replace("%", "v_").replace(".", "_")


def _value(operand: str, kind: str) -> str:
    special = {"%ntid.x": "1", "%ctaid.x": "thread", "%tid.x": "0"}
    if operand in special:
        return special[operand]
    if operand.startswith("%"):
        return _name(operand)
    if operand.startswith("0f"):
        return repr(bits_float(int(operand[2:], 16)))
    if operand.endswith("_param_0"):
        return "param"
    number = int(operand.rstrip("U"), 0)
    return repr(number & ((1 << int(kind[1:])) - 1) if kind[0] in "bus" else number)


def _address(operand: str) -> str:
    base, _, offset = operand[1:-1].partition("+")
    return f"({_value(base, 'u64')} + {int(offset or 0)})"


def _struct(kind: str) -> str:
    if kind == "f32":
        return "f"
    return {1: "B", 2: "H", 4: "I", 8: "Q"}[_SIZES[kind[1:]]]


def _memory(parts: list[str], operands: list[str]) -> str | None:
    kind = parts[-1]
    count = next((int(p[1:]) for p in parts if p in ("v2", "v4")), 1)
    names = [o.strip() for o in (operands[0] if parts[0] == "ld" else operands[-1]).strip("{}").split(",")]
    if parts[0] == "ld":
        return f"{', '.join(map(_name, names))} = m.load({_address(operands[1])}, {_struct(kind)!r}, {count})"
    if parts[0] == "st":
        values = ", ".join(_value(n, kind) for n in names)
        return f"m.store({_address(operands[0])}, {_struct(kind)!r}, {values})"
    return None


def _arithmetic(parts: list[str], operands: list[str]) -> str | None:
    op, kind = parts[0], parts[-1]
    target = _name(operands[0])
    if op == "cvta":
        return f"{target} = {_value(operands[1], 'u64')}"
    if op == "cvt":
        return f"{target} = {_convert(parts, _value(operands[1], kind))}"
    if op == "mov":
        value = _value(operands[1], kind)
        if kind == "b32" and operands[0].startswith("%r") and operands[1].startswith("%f"):
            value = f"float_bits({value})"
        if kind == "b32" and operands[0].startswith("%f"):
            value = f"bits_float({value})"
        return f"{target} = {value}"
    if kind == "pred":
        return f"{target} = {_logic(op, [_name(o) for o in operands[1:]])}"
    values = [_value(o, "b32" if op == "selp" and i == 2 else kind) for i, o in enumerate(operands[1:])]
    if op == "setp":
        return f"{target} = {_comparison(parts, values)}"
    if op == "selp":
        return f"{target} = {values[0]} if {values[2]} else {values[1]}"
    expression = _float(op, values) if kind == "f32" else _integer(op, parts, values)
    return expression and f"{target} = {expression}"


def _logic(op: str, names: list[str]) -> str:
    form = {"and": "{0} and {1}", "or": "{0} or {1}", "xor": "bool({0}) != bool({1})", "not": "not {0}"}
    if op not in form:
        raise NotImplementedError(f"PTX instruction {op}.pred")
    return form[op].format(*names)


def _comparison(parts: list[str], values: list[str]) -> str:
    test, kind = parts[1], parts[-1]
    if kind == "f32":
        a, b = values
        unordered = f"({a} != {a} or {b} != {b})"
        if test == "nan":
            return unordered
        if test.endswith("u") and test[:-1] in _COMPARE:
            return f"{unordered} or {a} {_COMPARE[test[:-1]]} {b}"
        return f"{a} {_COMPARE[test]} {b}"
    if kind[0] == "s":
        values = [f"signed({v}, {kind[1:]})" for v in values]
    return f"{values[0]} {_COMPARE[test]} {values[1]}"


def _float(op: str, v: list[str]) -> str | None:
    if op in ("add", "sub", "mul"):
        return f"f32({v[0]} {dict(add='+', sub='-', mul='*')[op]} {v[1]})"
    return {
        "div": "divide({0}, {1})",
        "sqrt": "f32(math.sqrt({0}))",
        "neg": "-{0}",
        "abs": "abs({0})",
        "min": "f_min({0}, {1})",
        "max": "f_max({0}, {1})",
    }.get(op, "").format(*v) or None


def _integer(op: str, parts: list[str], v: list[str]) -> str | None:
    bits = int(parts[-1][1:])
    mask, is_signed = (1 << bits) - 1, parts[-1][0] == "s"
    if op == "mul" and parts[1] == "wide":
        a, b = (f"signed({x}, {bits})" if is_signed else x for x in v)
        return f"({a} * {b}) & {(1 << 2 * bits) - 1}"
    simple = {"add": "+", "sub": "-", "mul": "*", "and": "&", "or": "|", "xor": "^"}
    if op in simple:
        return f"({v[0]} {simple[op]} {v[1]}) & {mask}"
    if op == "not":
        return f"~{v[0]} & {mask}"
    if op == "mad":
        return f"({v[0]} * {v[1]} + {v[2]}) & {mask}"
    if op == "shl":
        return f"({v[0]} << min({v[1]}, 64)) & {mask}"
    if op == "shr":
        return f"({f'signed({v[0]}, {bits})' if is_signed else v[0]} >> min({v[1]}, 64)) & {mask}"
    if op == "div" and not is_signed:
        return f"{v[0]} // {v[1]}"
    return None


def _convert(parts: list[str], value: str) -> str:
    to, source = parts[-2], parts[-1]
    if to == "f32":
        return f"f32(signed({value}, {source[1:]}))" if source[0] == "s" else f"f32({value})"
    bits = int(to[1:])
    if source == "f32":
        low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if to[0] == "s" else (0, (1 << bits) - 1)
        return f"to_int({value}, {low}, {high}) & {(1 << bits) - 1}"
    return f"{f'signed({value}, {source[1:]})' if source[0] == 's' else value} & {(1 << bits) - 1}"
