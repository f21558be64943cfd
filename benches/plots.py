#!/usr/bin/env python3
"""Draws the plots of docs/PERFORMANCE.md into docs/pictures, from the data in docs/notebook.

    pip install matplotlib
    python3 benches/plots.py                                             # draw from the notebook
    python3 benches/plots.py --growth bench-all/scaling/results.csv      # first update growth.csv from a new run of the scaling suite

gate-width.svg shows the table of docs/notebook/gate-width.md. growth.svg shows the median costs in docs/notebook/growth.csv, divided by
the cost of the first step of each sweep.
"""
import argparse
import csv
import os
import re
from statistics import median

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

DOCS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../docs")
NOTEBOOK = os.path.join(DOCS, "notebook")
PICTURES = os.path.join(DOCS, "pictures")
ESTIMATORS = {"pt": "tab:gray", "bdpt": "tab:blue", "lcs-paper": "tab:green", "lcs": "tab:red"}
# First word of the scene's name, name of the sweep, column in results.csv.
SWEEPS = [
    ("triangles", "triangles", "triangles"),
    ("light", "light vertices", "light_vertices"),
    ("width", "gate width (m)", "gate_m"),
    ("side", "pixels", "pixels"),
]


def end_points(path):
    """Last row of each scene, variant and repetition."""
    ends = {}
    with open(path, newline="") as file:
        for row in csv.DictReader(file):
            ends[row["scene"], row["variant"], row["repetition"]] = row
    return ends


def growth_rows(path):
    """(sweep, variant, x, microseconds per pixel sample), as medians over the repetitions."""
    steps = {}
    for (scene, variant, _), row in end_points(path).items():
        for word, sweep, column in SWEEPS:
            # pt traces no light subpaths, so its number of light vertices does not change.
            if scene.split()[0] == word and not (sweep == "light vertices" and variant == "pt"):
                step = steps.setdefault((sweep, variant, scene), [])
                step.append((float(row[column]), float(row["us_per_sample"])))
    for (sweep, variant, _), values in steps.items():
        yield sweep, variant, median(x for x, _ in values), median(cost for _, cost in values)


def write_growth(path):
    with open(os.path.join(NOTEBOOK, "growth.csv"), "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["sweep", "variant", "x", "us_per_sample"])
        for sweep, variant, x, cost in sorted(growth_rows(path)):
            writer.writerow([sweep, variant, f"{x:.4g}", f"{cost:.4g}"])


def save(figure, name):
    figure.tight_layout()
    # Without a date (and with a fixed svg.hashsalt), the same data gives the same file.
    figure.savefig(os.path.join(PICTURES, name), metadata={"Date": None})
    plt.close(figure)


def draw_growth():
    with open(os.path.join(NOTEBOOK, "growth.csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    figure, axes = plt.subplots(1, len(SWEEPS), figsize=(11, 2.9), sharey=True)
    for axis, (_, sweep, _) in zip(axes, SWEEPS):
        for variant, colour in ESTIMATORS.items():
            steps = [(float(r["x"]), float(r["us_per_sample"])) for r in rows if (r["sweep"], r["variant"]) == (sweep, variant)]
            if steps:
                axis.loglog([x for x, _ in steps], [cost / steps[0][1] for _, cost in steps], "o-", color=colour, label=variant, ms=3)
        axis.set_xlabel(sweep)
        axis.grid(True, alpha=0.3)
        axis.minorticks_off()
    axes[0].set_ylabel("cost of a sample,\nrelative to the first step")
    axes[0].legend(fontsize=8)
    save(figure, "growth.svg")


def gate_width_rows():
    """Rows of the table in gate-width.md: (width, {estimator: (ratio over all pixels, ratio without the worst 1 %)}).

    A ratio is the error of the better of bdpt and pt, divided by the error of the estimator.
    """
    with open(os.path.join(NOTEBOOK, "gate-width.md")) as file:
        for line in file:
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
            if re.match(r"[\d.]+ units", cells[0]):
                # Remove the ranges in brackets.
                pairs = [[float(value) for value in re.sub(r"\([^)]*\)", "", cell).split(",")] for cell in cells[1:3]]
                yield float(cells[0].split()[0]), dict(zip(("lcs-paper", "lcs"), pairs))


def draw_gate_width():
    rows = list(gate_width_rows())
    figure, axis = plt.subplots(figsize=(5.5, 3.4))
    widths = [width for width, _ in rows]
    for estimator in ("lcs-paper", "lcs"):
        for which, (name, style) in enumerate([("all pixels", "o--"), ("without the worst 1 %", "o-")]):
            values = [pairs[estimator][which] for _, pairs in rows]
            axis.loglog(widths, values, style, color=ESTIMATORS[estimator], label=f"{estimator}, {name}", ms=4)
    axis.axhline(1, color="black", lw=0.8)
    axis.set_xlabel("width of the gate (units; the scene's diagonal is 961)")
    axis.set_ylabel("times lower error than\nthe better of bdpt and pt")
    axis.grid(True, alpha=0.3)
    axis.legend(fontsize=8, handlelength=3.5)
    save(figure, "gate-width.svg")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--growth", metavar="RESULTS", help="results.csv of the scaling suite")
    arguments = parser.parse_args()
    plt.rcParams.update({"svg.hashsalt": "taugate", "svg.fonttype": "none"})
    if arguments.growth:
        write_growth(arguments.growth)
    draw_growth()
    draw_gate_width()


if __name__ == "__main__":
    main()
