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
    """A magnetometer channel: sensor, band-pass, hold capacitors, low-pass; see the table in chain.rs."""

    states = 8
    outputs = [6]

    def __init__(self, p):
        self.p = p
        self.cpu_hz = p["cpu_hz"]
        self.kept = {}
        self.gain = p["lna_gain"] * p["band_pass_gain"]

    def band_pass(self, a, v, z):
        """Rows of the band-pass with output v; returns its width."""
        w = 2 * np.pi * self.p["band_pass_hz"]
        width = w / self.p["band_pass_quality"]
        a[v, v], a[v, z], a[z, v] = -width, -w, w
        return width

    def hold_and_low_pass(self, a, source, plus, minus, first):
        """Rows of the capacitors and the low-pass, from row `first`; the capacitors sample `source`."""
        p = self.p
        for state, closed in ((first, plus), (first + 1, minus)):
            a[state, state] = -1 / (p["leak_ohm"] * p["hold_f"])
            if closed:
                rate = 1 / (p["switch_ohm"] * p["hold_f"])
                a[state, state] -= rate
                a[state, source] = rate
        w = 2 * np.pi * p["low_pass_hz"]
        low, rest = first + 2, first + 3
        a[low, rest], a[rest, low], a[rest, rest] = w, -w, -np.sqrt(2) * w
        a[rest, first], a[rest, first + 1] = w / 2, -w / 2

    def matrices(self, carrier, plus, minus):
        p = self.p
        a, b = np.zeros((8, 8)), np.zeros(8)
        w = 2 * np.pi * p["resonance_hz"]
        a[0, 1], a[1, 0], a[1, 1] = w, -w, -w / p["quality"]
        b[1] = w / p["quality"] * p["sensitivity_v"] * self.gain * carrier
        a[2, 0] = self.band_pass(a, 2, 3)
        self.hold_and_low_pass(a, 2, plus, minus, 4)
        return a, b

    def rest(self):
        """The switches after reset."""
        return -1.0, False, False

    def switches(self, levels, pulses, start):
        """The switches from `start` on."""
        closed = lambda side: any(s <= start < e for s, e in pulses["Carrier"][side])
        return 1.0 if levels(start)["Carrier"] else -1.0, closed(False), closed(True)

    def timeline(self, edges, end):
        """Intervals (start, end, switches) in cycles, from the pins' edges."""
        pulses = {pin: {False: [], True: []} for pin in ("Carrier", "Strobe")}
        for cycle, pin, high in edges:
            if pin in pulses:
                pulses[pin][high].append((cycle, cycle + self.p["aperture_cycles"]))
        ends = {c for pin in pulses.values() for side in pin.values() for w in side for c in w}
        times = {0, end} | {c for c, _, _ in edges} | ends
        times |= set(range(0, end, self.p["span_cycles"])) | set(self.p["reads"])
        times = sorted(t for t in times if t <= end)

        def levels(at):
            pins = dict.fromkeys(("Carrier", "Strobe", "Select", "Settled"), False)
            pins.update((pin, high) for c, pin, high in edges if c <= at)
            return pins

        for start, stop in zip(times, times[1:]):
            yield start, stop, self.switches(levels, pulses, start)

    def run(self, edges, offset, amplitude, hz):
        """Voltages at the reads under offset + amplitude sin(2 pi hz t)."""
        value = lambda cycle: offset + amplitude * np.sin(2 * np.pi * hz * cycle / self.cpu_hz)
        a, b = self.matrices(*self.rest())
        x = -np.linalg.solve(a, b * value(0))
        volts, reads = [], set(self.p["reads"])
        advance = self.with_sine if self.p["continuous"] else self.with_lines
        for start, stop, switches in self.timeline(edges, max(reads)):
            a, b = self.matrices(*switches)
            x = advance(a, b, x, start, stop, value, (offset, amplitude, hz))
            if stop in reads:
                volts.append([2.5 + self.p["output_gain"] * x[output] for output in self.outputs])
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
        w, n = 2 * np.pi * hz, self.states
        whole = np.zeros((n + 3, n + 3))
        whole[:n, :n], whole[:n, n], whole[:n, n + 2] = a, b * amplitude, b * offset
        whole[n, n + 1], whole[n + 1, n] = w, -w
        # The same few intervals recur under the same few switches: keep their exponentials.
        key = (whole.tobytes(), stop - start)
        if key not in self.kept:
            self.kept[key] = linalg.expm(whole * (stop - start) / self.cpu_hz)
        phase = w * start / self.cpu_hz
        y = np.concatenate([x, [np.sin(phase), np.cos(phase), 1.0]])
        return (self.kept[key] @ y)[:n]


class TiltPair(Chain):
    """Both tilt channels with the one band-pass that they share, as one system of 14 states: the
    band-pass, then of x and of y the sensor, the hold capacitors, the low-pass. The force along y is
    `force_y` of that along x."""

    states = 14
    outputs = [6, 12]

    def matrices(self, carrier, select, closed):
        p, tau = self.p, 2 * np.pi
        a, b = np.zeros((14, 14)), np.zeros(14)
        width = self.band_pass(a, 0, 1)
        gas, detector = tau * p["convection_hz"], tau * p["detector_hz"]
        for channel, force in enumerate((1.0, p["force_y"])):
            first = 2 + 6 * channel
            a[first, first] = -gas
            a[first + 1, first], a[first + 1, first + 1] = detector, -detector
            b[first] = gas * p["sensitivity_v"] * self.gain * force
            self.hold_and_low_pass(a, 0, *closed[channel], first + 2)
            if select == channel:
                a[0, first + 1] = width * carrier
        return a, b

    def rest(self):
        return -1.0, 0, ((False, False), (False, False))

    def switches(self, levels, pulses, start):
        pins = levels(start)
        closed = [(False, False), (False, False)]
        selected = int(pins["Select"])
        if pins["Settled"] != pins["Select"]:
            # A pulse begins only where its strobe finds this channel's turn settled.
            began = lambda s: levels(s)["Select"] == pins["Select"] != levels(s)["Settled"]
            closed[selected] = tuple(
                any(s <= start < e and began(s) for s, e in pulses["Strobe"][side])
                for side in (False, True)
            )
        return 1.0 if pins["Carrier"] else -1.0, selected, tuple(closed)


def chain(request):
    kind = TiltPair if request["kind"] == "tilt" else Chain
    return kind(request).run([tuple(edge) for edge in request["edges"]], *request["input"])


def welch(request):
    """Density of samples (one-sided, units per rtHz) averaged over bands."""
    samples, rate = np.array(request["samples"]), request["rate_hz"]
    f, density = signal.welch(samples, rate, nperseg=request["segment"], detrend="constant")
    return [float(np.sqrt(density[(f >= lo) & (f < hi)].mean())) for lo, hi in request["bands"]]


request = json.load(sys.stdin)
print(json.dumps({"steps": steps, "chain": chain, "welch": welch}[request["task"]](request)))
