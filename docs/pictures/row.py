#!/usr/bin/env python3
"""Pastes the crops of a bench into one row with labels: row.py BENCH_FOLDER SCENE OUT.png

The bench has drawn SCENE.png: the reference, then the variants in the order of the suite, all with the exposure of the reference. The
row shows the variants first and the reference last. The labels are time, relMSE, and relMSE without the worst 1 % of the pixels, of the
same images. The exit code is 1 if the reference is too poor for a figure. Needs Pillow 10.1.
"""
import csv
import sys
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

GAP = 4  # White pixels between tiles, as in the bench's own picture.
LABEL = 78  # Height of the labels.

if len(sys.argv) != 4:
    sys.exit(__doc__)
folder, scene, out = Path(sys.argv[1]), sys.argv[2], sys.argv[3]

# Rows are in the order of time: the last one of a variant belongs to its image.
last = {}
with open(folder / "results.csv", newline="") as file:
    for row in csv.DictReader(file):
        if row["scene"] == scene and row["repetition"] == "0":
            last[row["variant"]] = row
if not last:
    sys.exit(f"{folder / 'results.csv'} has no results of {scene}")

poor = []


def figure(row, name, column, of_reference):
    """The error as text, by the rule of the bench for references."""
    error, own = float(row[column]), float(row[of_reference])
    if own <= 0.02 and own * 20 <= error:
        return f"{name} {error:.2g}"
    poor.append(f"{row['variant']}, {name}")
    return f"{name} -"


labels = []
for variant, row in last.items():
    time = float(row["seconds"])
    everything = figure(row, "relMSE", "relmse", "reference_relmse")
    trimmed = figure(row, "trimmed", "trimmed_relmse", "reference_trimmed_relmse")
    labels.append((f"{variant}, {time:.0f} s" if time >= 10 else f"{variant}, {time:.1f} s", everything, trimmed))
own = [max(float(row[column]) for row in last.values()) for column in ("reference_relmse", "reference_trimmed_relmse")]
labels.append(("reference", f"relMSE {own[0]:.1g}", f"trimmed {own[1]:.1g}"))

strip = Image.open(folder / f"{scene}.png").convert("RGB")
columns = len(labels)
width = (strip.width + GAP) // columns - GAP
height = (strip.height - GAP) // 2
tiles = [strip.crop((k * (width + GAP), 0, k * (width + GAP) + width, height)) for k in range(columns)]
tiles = tiles[1:] + tiles[:1]

row = Image.new("RGB", (strip.width, height + LABEL), "white")
draw = ImageDraw.Draw(row)
for k, (tile, lines) in enumerate(zip(tiles, labels)):
    left = k * (width + GAP)
    row.paste(tile, (left, 0))
    for line, text in enumerate(lines):
        font = ImageFont.load_default(20 if line == 0 else 16)
        draw.text((left + width // 2, height + 6 + 24 * line), text, "black", font, anchor="ma")
row.save(out)
if poor:
    sys.exit(f"{out}: the reference is too poor for {'; '.join(poor)}")
