#!/usr/bin/env python3
"""Compares estimators in histograms at equal time. Prints a Markdown page.

    pip install numpy
    cargo build --release
    python3 benches/histogram.py [--seconds 6] [--repetitions 3] [--case cornell-long] [--variant 'lcs K 32=--estimator lcs --queries 32'] > histogram.md

With --peer it also measures mitransient (pip install mitransient mitsuba; see peers.py), and all surfaces are diffuse.

Cases, for the Cornell box and for staircase: 300 bins over the range of arrival times, and 20 bins around the median arrival time,
each 1 % of the scene's diagonal wide. The variants take turns. Other work on the machine slows a render down, so each render has a
number of samples that takes about --seconds of processor time, not of wall time. The figure to compare is the error times the
processor time, start-up excluded. It does not depend on how long a render takes.

The error is relMSE per bin, averaged over bins: the mean of (x - r)^2 / (r^2 + eps) over pixels and channels, with eps = (1 % of the
mean of the bin)^2. Bins with less than a thousandth of the light of the brightest bin are left out. The reference has two halves,
a from bdpt and b from lcs, with another seed than the variants; r is their mean. (x - a) (x - b) replaces (x - r)^2: its expected
value contains no error of the reference. The page also states the relMSE of the reference, computed from (a - b)^2 / 4.
"""
import argparse
import os
import shlex
import subprocess
import sys
import tempfile

try:
    import numpy as np
except ImportError:
    print("skipped: numpy is not installed")
    sys.exit(0)

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
SHARED = os.environ.get("TAUGATE_SHARED_SCENES", os.path.join(ROOT, "../shared/scenes"))
CORNELL = os.path.join(ROOT, "scenes/cornell-box.glb")
STAIRCASE = os.path.join(SHARED, "staircase/scene.glb")
# Name: scene, gates in metres and their number, image size.
CASES = {
    "cornell-long": (CORNELL, (4.3, 16.3), 300, (32, 32)),
    "cornell-short": (CORNELL, (6.02, 6.72), 20, (32, 32)),
    "staircase-long": (STAIRCASE, (9.3, 57.3), 300, (24, 42)),
    "staircase-short": (STAIRCASE, (14.21, 17.07), 20, (24, 42)),
}
VARIANTS = ("pt", "bdpt", "lcs")
BASELINE = "bdpt"
PEER = "mitransient"
MAX_DEPTH = 24
DIM = 1e-3
# Samples per pixel of the render that measures the cost of a sample.
PILOT = 32
DARK = 0.01


def cpu_seconds(command):
    """Runs a command and returns its seconds of processor time."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{shlex.join(command)} failed")
    return usage.ru_utime + usage.ru_stime


class Case:
    """A scene with its gates, and for each variant the start-up time and the time per sample."""

    def __init__(self, arguments, scene, gates, bins, size, folder):
        self.binary, self.scene, self.folder, self.size, self.gates, self.bins = arguments.binary, scene, folder, size, gates, bins
        self.costs = {}

    def command(self, flags, samples, seed, out):
        return [self.binary, "render", self.scene, "--gates", f"{self.gates[0]!r}m..{self.gates[1]!r}m/{self.bins}", "--resolution",
                f"{self.size[0]}x{self.size[1]}", "--max-depth", str(MAX_DEPTH), "--seed", str(seed), "--quiet", "-o", out, "--spp", str(samples), *flags]

    def render(self, flags, seconds, seed):
        """The histogram after about `seconds` of processor time, and this time without start-up."""
        out, key = os.path.join(self.folder, "out.npy"), tuple(flags)
        if key not in self.costs:
            # The first render may compile kernels and is not counted.
            _, start_up, pilot = (cpu_seconds(self.command(flags, samples, 0, out)) for samples in (1, 1, PILOT))
            self.costs[key] = start_up, max((pilot - start_up) / (PILOT - 1), 1e-6)
        start_up, per_sample = self.costs[key]
        spent = cpu_seconds(self.command(flags, max(PILOT, round(seconds / per_sample)), seed, out))
        return np.load(out).astype(np.float64), spent - start_up


class Peer:
    """mitransient, which renders in passes of equal size. The first passes compile its kernels and find this size, `spp`."""

    def __init__(self, peers, document, binary, case, seconds):
        self.mi = peers.mi
        self.scene = peers.mitsuba_scene(document, binary, case.size, case.gates, case.bins)
        self.spp = 1
        while True:
            self.render_pass(1)
            if self.render_pass(2)[1] >= seconds / 8 or self.spp >= 1024:
                break
            self.spp *= 2

    def render_pass(self, seed):
        before = sum(os.times()[:2])
        _, frames = self.mi.render(self.scene, spp=self.spp, seed=seed)
        return np.array(frames, dtype=np.float64)[..., :3], sum(os.times()[:2]) - before

    def render(self, seconds, seed):
        """The histogram after at least `seconds` of processor time, and this time."""
        total, spent, passes = 0.0, 0.0, 0
        while spent < seconds:
            frames, took = self.render_pass(1000 * seed + passes)
            total, spent, passes = total + frames, spent + took, passes + 1
        return total / passes, spent


class Reference:
    """Two independent halves of the reference."""

    def __init__(self, a, b):
        self.a, self.b, self.r = a, b, 0.5 * (a + b)
        means = self.r.mean(axis=(0, 1, 3))
        self.kept = means >= DIM * means.max()
        self.eps = (DARK * means) ** 2

    def errors(self, squared):
        """relMSE per bin that is kept."""
        return (squared / (self.r ** 2 + self.eps[:, None])).mean(axis=(0, 1, 3))[self.kept]

    def of(self, x):
        return self.errors((x - self.a) * (x - self.b))

    def own(self):
        return self.errors((self.a - self.b) ** 2 / 4).mean()


def deciles(errors):
    return np.array([part.mean() for part in np.array_split(errors, 10)])


def spread(values):
    return f"{np.median(values):.3g} ({min(values):.3g} to {max(values):.3g})"


def compare(arguments, name, variants, folder):
    scene, gates, bins, size = CASES[name]
    peer = None
    case = Case(arguments, scene, gates, bins, size, folder)
    if arguments.peer:
        import peers
        document, binary = peers.glb.read(scene)
        document = peers.simplified(document, binary, folder)
        case.scene = os.path.join(folder, f"{name}.glb")
        peers.glb.write(case.scene, document, binary)
        peer = Peer(peers, document, binary, case, arguments.seconds)
    # Estimators share random numbers if they share a seed, and the halves of the reference must be independent.
    halves = [case.render(["--estimator", estimator], arguments.reference * arguments.seconds, seed)[0]
              for estimator, seed in (("bdpt", 901), ("lcs", 902))]
    reference = Reference(*halves)
    names = [*variants, *([PEER] if peer else [])]
    errors, spent = {n: [] for n in names}, {n: [] for n in names}
    for repetition in range(arguments.repetitions):
        for variant in names:
            if variant == PEER:
                image, seconds = peer.render(arguments.seconds, 1 + repetition)
            else:
                image, seconds = case.render(variants[variant], arguments.seconds, 1 + repetition)
            errors[variant].append(reference.of(image))
            spent[variant].append(seconds)

    print(f"\n## {name}\n\n{size[0]} x {size[1]} pixels, {bins} bins from {gates[0]} m to {gates[1]} m, of which {reference.kept.sum()} count. "
          f"Reference: {arguments.reference * arguments.seconds:g} s of processor time by bdpt and as long by lcs, own relMSE {reference.own():.2e}.\n")
    print(f"| variant | processor seconds | relMSE | relMSE times processor seconds | relative to {BASELINE} | tenths of the bins, relative "
          f"to {BASELINE}, early to late |\n|---|---|---|---|---|---|")
    costs = {n: [e.mean() * s for e, s in zip(errors[n], spent[n])] for n in names}
    tenths = {n: np.median([deciles(e) * s for e, s in zip(errors[n], spent[n])], axis=0) for n in names}
    for n in names:
        ratios = [mine / theirs for mine, theirs in zip(costs[n], costs[BASELINE])]
        parts = " ".join(f"{x:.2f}" for x in tenths[n] / tenths[BASELINE])
        print(f"| {n} | {np.median(spent[n]):.1f} | {spread([e.mean() for e in errors[n]])} | {spread(costs[n])} | {spread(ratios)} | {parts} |")
    sys.stdout.flush()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--binary", default=os.path.join(ROOT, "target/release/taugate"))
    parser.add_argument("--seconds", type=float, default=6.0, help="processor time per variant and repetition")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--reference", type=float, default=15.0, help="time of each half of the reference, in units of --seconds")
    parser.add_argument("--case", action="append", choices=list(CASES), help="may be repeated; default: all that are on this machine")
    parser.add_argument("--variant", action="append", default=[], metavar="NAME=FLAGS", help="further flags of render to measure")
    parser.add_argument("--peer", action="store_true", help="also measure mitransient, on diffuse copies of the scenes")
    arguments = parser.parse_args()
    variants = {name: ["--estimator", name] for name in VARIANTS}
    for text in arguments.variant:
        name, _, flags = text.partition("=")
        variants[name] = shlex.split(flags)
    version = subprocess.run([arguments.binary, "--version"], check=True, capture_output=True, text=True).stdout.strip()
    print(f"# histogram\n\n{version}, {os.cpu_count()} cores, {arguments.seconds:g} s of processor time per render, {arguments.repetitions} repetitions. Numbers are medians, "
          "with minimum and maximum in brackets.")
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.case or CASES:
            if os.path.exists(CASES[name][0]):
                compare(arguments, name, variants, folder)
            else:
                print(f"\nskipped {name}: {CASES[name][0]} is not on this machine")


if __name__ == "__main__":
    main()
