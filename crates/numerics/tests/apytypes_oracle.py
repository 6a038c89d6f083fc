"""Evaluates fixed-point operations with apytypes: one per line on stdin, one raw result per line.

A line holds: operation, raw, word and fractional bits of a and of b, word and fractional bits of
the result, rounding and overflow by their names in word-length files. apytypes computes the
operation exactly; its cast rounds and limits.
"""

import sys

from apytypes import APyFixed, OverflowMode, QuantizationMode

ROUNDING = {
    "floor": QuantizationMode.TO_NEG,
    "ceil": QuantizationMode.TO_POS,
    "zero": QuantizationMode.TO_ZERO,
    "nearest_up": QuantizationMode.TIES_POS,
    "nearest_away": QuantizationMode.TIES_AWAY,
    "nearest_even": QuantizationMode.TIES_EVEN,
}
OVERFLOW = {"wrap": OverflowMode.WRAP, "saturate": OverflowMode.SAT}
OPERATIONS = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "neg": lambda a, b: -a,
    "abs": lambda a, b: abs(a),
    "same": lambda a, b: a,
}
# More than any operation here has.
INTEGER_BITS = 160


def fixed(raw, word, frac):
    """The number raw / 2^frac of `word` bits."""
    return APyFixed(int(raw), bits=int(word), frac_bits=int(frac))


for line in sys.stdin:
    operation, a, aw, af, b, bw, bf, word, frac, rounding, overflow = line.split()
    word, frac = int(word), int(frac)
    exact = OPERATIONS[operation](fixed(a, aw, af), fixed(b, bw, bf))
    # Wide first, exactly: apytypes 0.5.1 limits wrongly where rounding, or more fractional bits,
    # take a number across a multiple of 64 bits.
    exact = exact.cast(int_bits=INTEGER_BITS, frac_bits=max(exact.frac_bits, frac))
    result = exact.cast(
        bits=word,
        frac_bits=frac,
        quantization=ROUNDING[rounding],
        overflow=OVERFLOW[overflow],
    )
    pattern = result.to_bits()
    print(pattern - (1 << word) if pattern >> (word - 1) else pattern)
