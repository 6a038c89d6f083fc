"""Shares and errors of docs/half-space.md: the equations in numpy on recordings of BROAD.

    python3 docs/half_space.py FOLDER      (numpy, scipy)

Independent of the workspace's Rust: recorded specific force and field go through low-passes of the front
end's corners and through noise of the sensors' size, are averaged over 8 ms and solved. Columns: unflagged
%, rms, 99th percentile (degrees), % of the unflagged beyond 30 degrees, largest error.
"""

import csv
import gzip
import sys
from pathlib import Path

import numpy as np
from scipy.signal import butter, lfilter, sosfilt
from scipy.spatial.transform import Rotation, Slerp

FILES = [
    "02_undisturbed_slow_rotation_B.csv.gz",
    "05_undisturbed_slow_rotation_with_breaks_B.csv.gz",
]
RATE = 2000.0  # conversions per channel and second
PERIOD_S = 16 / RATE
DELAY_S = 0.0157  # of the low-passes and the average
# Recorded z points up: body x is sensor y, body y is sensor x, body z is sensor -z.
MOUNTING = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
# The rules of crates/spec.
LEAST_DOWN, LEAST_SUM, LEAST_EAST, DOMAIN, RESIDUAL = 0.03, 0.1, 0.01, 1.125, 0.15
MOST = 3.0


def load(path):
    with gzip.open(path, "rt") as lines:
        rows = list(csv.DictReader(lines))
    column = lambda name: np.array([float(row[name] or "nan") for row in rows])
    stack = lambda names: np.stack([column(name) for name in names], 1)
    return (
        column("t_s"),
        stack([f"acc_{axis}_m_s2" for axis in "xyz"]),
        stack([f"mag_{axis}_uT" for axis in "xyz"]),
        stack(["ref_qx", "ref_qy", "ref_qz", "ref_qw"]),
    )


def readings(path):
    """Gravity in g and field over |B| in body axes, the true attitudes, and h, v."""
    time, force, field, quaternion = load(path)
    known = ~np.isnan(quaternion).any(1)
    orientation = Rotation.from_quat(quaternion[known])
    east, north, up = np.median(orientation.apply(field[known]), 0)
    horizontal, vertical = np.hypot(east, north), -up
    total = np.hypot(horizontal, vertical)
    sine, cosine = east / horizontal, north / horizontal
    ned_to_enu = np.array([[sine, cosine, 0], [cosine, -sine, 0], [0, 0, -1.0]])
    fine = np.arange(time[0], time[-1], 1 / RATE)
    even = lambda x: np.stack([np.interp(fine, time, x[:, k]) for k in range(3)], 1)
    pole = np.exp(-2 * np.pi * 50 / RATE)
    force = sosfilt(butter(2, 50, fs=RATE, output="sos"), even(force), axis=0)
    force = lfilter([1 - pole], [1, -pole], force, axis=0)
    field = sosfilt(butter(2, 28, fs=RATE, output="sos"), even(field), axis=0)
    average = lambda x: lfilter(np.ones(16) / 16, [1], x, axis=0)[200::16]
    random = np.random.default_rng(1)
    gravity = -average(force) / np.median(np.linalg.norm(force, axis=1))
    field = average(field) / total
    gravity += random.normal(0, 0.0017, gravity.shape)
    field += random.normal(0, 0.8 / total, field.shape)
    at = np.clip(fine[200::16] - DELAY_S, time[known][0], time[known][-1])
    truth = Slerp(time[known], orientation)(at).as_matrix().transpose(0, 2, 1) @ ned_to_enu
    body = lambda x: x @ MOUNTING.T
    return body(gravity), body(field), MOUNTING @ truth, horizontal / total, vertical / total


def wrap(x):
    return (x + np.pi) % (2 * np.pi) - np.pi


def solve(x, y, down, bx, by, h, v):
    """Both sets and their weighted mean, for the upright half-space."""
    cos_1 = np.sqrt(np.maximum(1 - x * x, 1e-9))
    cos_2 = np.sqrt(np.maximum(1 - y * y, 1e-9))
    down = np.maximum(down, 1e-6)
    c_1, s_2 = (bx - v * x) / (h * cos_1), (v * y - by) / (h * cos_2)
    sin_roll, cos_roll = np.clip(y / cos_1, -1, 1), down / cos_1
    s_1 = ((v * y - by) / h - x * sin_roll * c_1) / cos_roll
    cross_2 = (bx - v * x) / h * cos_2 - x * y * s_2
    yaw_1 = np.where(s_1 < 0, -1, 1) * np.arccos(np.clip(c_1, -1, 1))
    sine = np.clip(s_2, -1, 1)
    cosine = np.where(cross_2 < 0, -1, 1) * np.sqrt(1 - sine * sine)
    yaw_2 = np.arctan2(down * sine - x * y * cosine, down * cosine + x * y * sine)
    square = c_1**2 + s_1**2
    e_1, e_2 = cos_1 * s_1, cos_roll * c_1 - x * sin_roll * s_1
    east = e_1**2 + e_2**2
    yaw = wrap(yaw_2 + e_1**2 / np.maximum(east, 1e-12) * wrap(yaw_1 - yaw_2))
    angles = yaw, np.arcsin(np.clip(-x, -1, 1)), np.arctan2(sin_roll, cos_roll)
    return angles, square, c_1, s_2, east / np.maximum(square, 1e-12)


def errors(angles, over, truth):
    """Degrees of rotation; (yaw, pitch, roll) is (-yaw, pitch, half a turn - roll) upside down."""
    yaw, pitch, roll = angles
    found = Rotation.from_euler(
        "ZYX",
        np.stack([np.where(over, -yaw, yaw), pitch, np.where(over, np.pi - roll, roll)], 1),
    )
    return np.degrees((found * Rotation.from_matrix(truth)).magnitude())


def track(down_square, field_square, product):
    """Where d3 is negative by tracking, and from where on the signs are lost."""
    over = np.empty(len(product), bool)
    down, field = 1, 1 if product[0] >= 0 else -1
    for k, q in enumerate(product):
        sign = 1 if q >= 0 else -1
        if down_square[k] < field_square[k]:
            down = field * sign
        else:
            field = down * sign
        over[k] = down < 0
    return over, np.maximum.accumulate(down_square + field_square < LEAST_SUM)


def largest(excess, memory_s):
    if memory_s == 0:
        return excess
    left, value, out = 1 - PERIOD_S / memory_s, 0.0, np.empty(len(excess))
    for k, x in enumerate(np.minimum(excess, MOST)):
        value = out[k] = max(x, value * left)
    return out


def table_cell(recording, is_measured, inconsistency, acceleration, memory_s):
    gravity, field, truth, h, v = recording
    force_square = (gravity**2).sum(1)
    plane = (gravity[:, :2] ** 2).sum(1)
    if is_measured:
        direction = gravity / np.sqrt(force_square)[:, None]
        x, y, down = direction[:, 0], direction[:, 1], np.abs(direction[:, 2])
        down_square, excess = down**2, np.abs(force_square - 1)
    else:
        x, y, down_square = gravity[:, 0], gravity[:, 1], 1 - plane
        down, excess = np.sqrt(np.maximum(down_square, 0)), np.maximum(plane - 1, 0)
    bx, by = field[:, 0], field[:, 1]
    angles, square, c_1, s_2, east = solve(x, y, down, bx, by, h, v)
    product, field_square = v - bx * x - by * y, 1 - bx * bx - by * by
    good = (down_square > LEAST_DOWN) & (east > LEAST_EAST)
    good &= (np.abs(c_1) < DOMAIN) & (np.abs(s_2) < DOMAIN)
    good &= np.abs(product**2 - down_square * field_square) < RESIDUAL
    over = gravity[:, 2] < 0
    if not is_measured:
        over, lost = track(down_square, field_square, product)
        good &= ~lost
    good &= largest(np.abs(square - 1), memory_s) <= inconsistency
    good &= largest(excess, memory_s) <= acceleration
    error = errors(angles, over, truth)[good]
    beyond = 100 * np.mean(error > 30)
    return (
        f"{100 * good.mean():.1f} / {np.sqrt(np.mean(error**2)):.1f} / "
        f"{np.percentile(error, 99):.1f} / {beyond:.2f} / {error.max():.0f}"
    )


def main():
    recordings = [readings(Path(sys.argv[1]) / name) for name in FILES]
    none = np.inf
    rows = [
        (none, none, 0), (0.5, 0.25, 0), (0.5, 0.25, 0.064), (0.5, 0.25, 0.128),
        (0.4, 0.2, 0.256), (0.5, 0.25, 0.256), (0.6, 0.25, 0.256), (0.6, 0.3, 0.256), (0.8, 0.4, 0.256),
    ]
    for is_measured in (True, False):
        print("\nthird axis measured" if is_measured else "\nno third axis")
        print("| inconsistency | acceleration | memory, s | 02 | 05 |\n|---|---|---|---|---|")
        for row in rows:
            cells = [table_cell(recording, is_measured, *row) for recording in recordings]
            limits = ["none" if limit == none else f"{limit:g}" for limit in row[:2]]
            print("|", " | ".join([*limits, f"{row[2]:g}", *cells]), "|")


if __name__ == "__main__":
    main()
