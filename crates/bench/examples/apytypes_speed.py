"""Times apytypes on the arithmetic of a recorded tape, operation by operation on whole arrays.

Does less than a trial: selections, roots and truths, which apytypes does not have, are left out (a
selection and a root stand for a cast of their operand), no value feeds back, and divisors are never 0."""

import random
import sys
import time

import apytypes as apy
from apytypes import APyFixedArray, OverflowMode, QuantizationMode

ROUNDING = {
    "floor": QuantizationMode.TRN,
    "ceil": QuantizationMode.TO_POS,
    "zero": QuantizationMode.TRN_ZERO,
    "nearest_up": QuantizationMode.RND,
    "nearest_away": QuantizationMode.RND_INF,
    "nearest_even": QuantizationMode.RND_CONV,
}
OVERFLOW = {"wrap": OverflowMode.WRAP, "saturate": OverflowMode.SAT, "trap": OverflowMode.SAT}

lines = open(sys.argv[1]).read().split("\n")
lanes = int(lines[0])
formats = []
ops = []
for line in lines[1:]:
    words = line.split()
    if words[0] == "node":
        formats.append((int(words[1]), int(words[2]), ROUNDING[words[3]], OVERFLOW[words[4]]))
    else:
        ops.append((int(words[1]), words[2], words[3:]))

random.seed(1)
fixed = {}
for number, (node, op, args) in enumerate(ops):
    if op in ("input", "constant"):
        word, frac, _, _ = formats[node]
        if op == "constant":
            fixed[number] = APyFixedArray.from_float([float(args[0])] * lanes, bits=word, frac_bits=frac)
        else:
            raws = [random.randrange(-300, 300) for _ in range(lanes)]
            fixed[number] = APyFixedArray(raws, bits=32, frac_bits=int(args[0]))
# Divisors are never 0, which apytypes refuses: what stands in the columns depends on roots.
divisors = {}
for number, (node, op, args) in enumerate(ops):
    if op == "div":
        word, frac, _, _ = formats[ops[int(args[1])][0]]
        raws = [random.randrange(1, 1 << (word - 1)) for _ in range(lanes)]
        divisors[number] = APyFixedArray(raws, bits=word, frac_bits=frac)


def run():
    values = [fixed.get(number) for number in range(len(ops))]
    writes = 0
    for number, (node, op, args) in enumerate(ops):
        if op == "truth":
            continue
        word, frac, rounding, overflow = formats[node]
        if op == "constant":
            values[number] = fixed[number]
            continue
        writes += 1
        if op == "input":
            exact = fixed[number]
        else:
            a = values[int(args[0])]
            if op == "add":
                exact = a + values[int(args[1])]
            elif op == "sub":
                exact = a - values[int(args[1])]
            elif op == "mul":
                exact = a * values[int(args[1])]
            elif op == "div":
                exact = a / divisors[number]
            elif op == "neg":
                exact = -a
            elif op == "abs":
                exact = abs(a)
            elif op == "shift":
                power = int(args[1])
                exact = a << power if power >= 0 else a >> -power
            else:
                exact = a if a is not None else values[int(args[-1])]
        values[number] = exact.cast(bits=word, frac_bits=frac, quantization=rounding, overflow=overflow)
    return writes


# What feeds back comes later in the tape: a first value in its node's format.
for number, (node, op, args) in enumerate(ops):
    if op == "select":
        other = args[1] if int(args[1]) < number else args[0]
        ops[number] = (node, op, [other, other])

best, writes = float("inf"), 0
for _ in range(7):
    begin = time.perf_counter()
    writes = run()
    best = min(best, time.perf_counter() - begin)
print(f"apytypes {apy.__version__}: {lanes * writes / best / 1e6:.0f} M node writes/s ({writes} writes)")
