"""Oracle for the front end: numpy and scipy on the equations of chain.rs, written anew.

Reads one JSON document on standard input, {"task": ..., ...}, and prints one JSON document.
"""

import json
import sys

import numpy as np
from scipy import integrate, linalg, signal


def steps(request):
    """exp(A h), its integral over B, and the noise covariance, by Van Loan's block matrices."""
    answers = []
    for case in request["cases"]:
        a, b, w = (np.array(case[name]) for name in "abw")
        h, n, m = case["h"], a.shape[0], b.shape[1]
        block = np.zeros((n + m, n + m))
        block[:n, :n], block[:n, n:] = a, b
        e = linalg.expm(block * h)
        loan = np.zeros((2 * n, 2 * n))
        loan[:n, :n], loan[:n, n:], loan[n:, n:] = -a, w, a.T
        f = linalg.expm(loan * h)
        phi = f[n:, n:].T
        answers.append(
            {"phi": e[:n, :n].tolist(), "gamma": e[:n, n:].tolist(), "q": (phi @ f[:n, n:]).tolist()}
        )
    return answers


class Chain:
    """One channel: sensor, band-pass, hold capacitors, low-pass; see the table in chain.rs."""

    def __init__(self, p):
        self.p = p
        self.cpu_hz = p["cpu_hz"]
        self.kept = {}
        self.gain = p["lna_gain"] * p["band_pass_gain"]

    def matrices(self, carrier, plus, minus):
        p, tau = self.p, 2 * np.pi
        a, b = np.zeros((8, 8)), np.zeros(8)
        bias = drive = 1.0
        if p["kind"] == "tilt":
            gas, detector = tau * p["convection_hz"], tau * p["detector_hz"]
            a[0, 0], a[1, 0], a[1, 1] = -gas, detector, -detector
            b[0] = gas * p["sensitivity_v"] * self.gain
            sensed, bias = 1, carrier
        else:
            w = tau * p["resonance_hz"]
            a[0, 1], a[1, 0], a[1, 1] = w, -w, -w / p["quality"]
            drive = carrier
            b[1] = w / p["quality"] * p["sensitivity_v"] * self.gain * drive
            sensed = 0
        w = tau * p["band_pass_hz"]
        a[2, sensed] = w / p["band_pass_quality"] * bias
        a[2, 2], a[2, 3], a[3, 2] = -w / p["band_pass_quality"], -w, w
        for state, closed in ((4, plus), (5, minus)):
            a[state, state] = -1 / (p["leak_ohm"] * p["hold_f"])
            if closed:
                rate = 1 / (p["switch_ohm"] * p["hold_f"])
                a[state, state] -= rate
                a[state, 2] = rate
        w = tau * p["low_pass_hz"]
        a[6, 7], a[7, 6], a[7, 7] = w, -w, -np.sqrt(2) * w
        a[7, 4], a[7, 5] = w / 2, -w / 2
        return a, b

    def timeline(self, edges, end):
        """Intervals (start, end, carrier, plus, minus) in cycles, from the pins' edges."""
        strobe = "Strobe" if self.p["kind"] == "tilt" else "Carrier"
        closed = {True: [], False: []}
        for cycle, pin, high in edges:
            if pin == strobe:
                closed[high].append((cycle, cycle + self.p["aperture_cycles"]))
        times = {0, end} | {c for c, _, _ in edges} | {c for v in closed.values() for w in v for c in w}
        times |= set(range(0, end, self.p["span_cycles"])) | set(self.p["reads"])
        times = sorted(t for t in times if t <= end)
        carrier_edges = [(c, high) for c, pin, high in edges if pin == "Carrier"]
        for start, stop in zip(times, times[1:]):
            level = [high for c, high in carrier_edges if c <= start][-1:]
            carrier = 1.0 if level and level[0] else -1.0
            plus, minus = (any(s <= start < e for s, e in closed[side]) for side in (False, True))
            yield start, stop, carrier, plus, minus

    def run(self, edges, offset, amplitude, hz):
        """Voltages at the reads under offset + amplitude sin(2 pi hz t)."""
        value = lambda cycle: offset + amplitude * np.sin(2 * np.pi * hz * cycle / self.cpu_hz)
        a, b = self.matrices(-1.0, False, False)
        x = -np.linalg.solve(a, b * value(0))
        volts, reads = [], set(self.p["reads"])
        advance = self.with_sine if self.p["continuous"] else self.with_lines
        for start, stop, *switches in self.timeline(edges, max(reads)):
            a, b = self.matrices(*switches)
            x = advance(a, b, x, start, stop, value, (offset, amplitude, hz))
            if stop in reads:
                volts.append(2.5 + self.p["output_gain"] * x[6])
        return volts

    def with_lines(self, a, b, x, start, stop, value, _):
        """Integrates numerically; the input is straight between the ends of its span."""
        span = self.p["span_cycles"]
        low = start // span * span
        u0, u1 = value(low), value(low + span)
        u = lambda t: u0 + (u1 - u0) * (t * self.cpu_hz - low) / span
        solution = integrate.solve_ivp(
            lambda t, x: a @ x + b * u(t),
            (start / self.cpu_hz, stop / self.cpu_hz),
            x, method="DOP853", rtol=1e-12, atol=1e-14,
        )
        return solution.y[:, -1]

    def with_sine(self, a, b, x, start, stop, _, sine):
        """Exactly, with the input's sine as further states."""
        offset, amplitude, hz = sine
        w = 2 * np.pi * hz
        whole = np.zeros((11, 11))
        whole[:8, :8], whole[:8, 8], whole[:8, 10] = a, b * amplitude, b * offset
        whole[8, 9], whole[9, 8] = w, -w
        # The same few intervals recur under the same few switches: keep their exponentials.
        key = (whole.tobytes(), stop - start)
        if key not in self.kept:
            self.kept[key] = linalg.expm(whole * (stop - start) / self.cpu_hz)
        phase = w * start / self.cpu_hz
        y = np.concatenate([x, [np.sin(phase), np.cos(phase), 1.0]])
        return (self.kept[key] @ y)[:8]


def chain(request):
    return Chain(request).run([tuple(edge) for edge in request["edges"]], *request["input"])


def welch(request):
    """Density of samples (one-sided, units per rtHz) averaged over bands."""
    samples, rate = np.array(request["samples"]), request["rate_hz"]
    f, density = signal.welch(samples, rate, nperseg=request["segment"], detrend="constant")
    return [float(np.sqrt(density[(f >= lo) & (f < hi)].mean())) for lo, hi in request["bands"]]


request = json.load(sys.stdin)
print(json.dumps({"steps": steps, "chain": chain, "welch": welch}[request["task"]](request)))
