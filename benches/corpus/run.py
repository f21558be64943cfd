#!/usr/bin/env python3
"""Opens and renders every glTF file of a folder, and makes contact sheets and a table of the results.

    pip install numpy pillow OpenEXR
    cargo build --release
    python3 benches/corpus/run.py FOLDER [--program target/release/taugate] [--out FOLDER/results]

Each file is rendered with `--camera auto --headlamp`, so files without camera or light show something as well. The output folder
gets `results.csv` and the contact sheets `sheet-NN.png`. The exposure of each picture follows its brightness. Results:

    rendered   the file opened without a warning
    warned     it opened; the warnings name what is ignored
    refused    exit code 2: one sentence says why
    failed     any other end, which is a defect: a panic, no end within --limit seconds, or values that are not finite
    empty      less than 0.5 % of the pixels are lit
"""
import argparse
import csv
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image, ImageDraw

ROOT = Path(__file__).resolve().parents[2]
MODELS = (".glb", ".gltf", ".vrm")
COLUMNS, ROWS, LABEL = 8, 6, 26
COLOURS = {"rendered": "white", "warned": "khaki", "refused": "lightsalmon", "failed": "red", "empty": "red"}


def render(program, path, image, size, spp, limit):
    """Renders one file; returns its result and what the program said about it."""
    picture = image.with_suffix(".png")
    command = [program, "render", path, "--camera", "auto", "--headlamp", "--resolution", f"{size}x{size}", "--spp", str(spp),
               "--force", "-o", image, "--png", picture]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit)
    except subprocess.TimeoutExpired:
        return "failed", f"no end within {limit} s"
    lines = done.stderr.splitlines()
    warnings = [line.removeprefix("warning: ") for line in lines if line.startswith("warning: ")]
    errors = [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]
    if any(error.startswith("unexpected argument") for error in errors):
        sys.exit(f"{program} is another version: {errors[0]}")
    if done.returncode == 2 and errors:
        return "refused", errors[0].replace(str(path) + ": ", "").replace(f"{path} ", "")
    if done.returncode:
        return "failed", f"exit code {done.returncode}: {' '.join(lines[-3:])}"
    pixels = OpenEXR.File(str(image)).channels()["RGB"].pixels
    if not np.isfinite(pixels).all():
        return "failed", "values that are not finite"
    said = "; ".join(warnings)
    if (pixels.max(axis=2) > 0).mean() < 0.005:
        return "empty", said
    return ("warned" if warnings else "rendered"), said


def cell(picture, name, result, size):
    """A picture with its name below, in the colour of its result."""
    made = Image.new("RGB", (size, size + LABEL), "black")
    if picture.exists():
        with Image.open(picture) as source:
            made.paste(source.convert("RGB"), (0, 0))
    draw = ImageDraw.Draw(made)
    if not picture.exists():
        draw.text((4, size // 2), result, fill=COLOURS[result])
    for line in range(2):
        draw.text((2, size + 12 * line), name[21 * line:21 * (line + 1)], fill=COLOURS[result])
    return made


def short(path):
    """Folder and name of a file, as far as they fit below a picture."""
    parts = [part for part in path.parts if part not in ("glTF", "glTF2", "assets", "meshes", "visual", "none.glb", "left.glb")]
    return "/".join(parts[-2:])[-42:]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--program", type=Path, default=ROOT / "target/release/taugate")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--size", type=int, default=128, help="pixels per side")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--limit", type=float, default=120, help="seconds per file")
    args = parser.parse_args()
    folder = args.folder / "files" if (args.folder / "files").is_dir() else args.folder
    out = args.out or args.folder / "results"
    out.mkdir(parents=True, exist_ok=True)
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in MODELS)
    if not files:
        sys.exit(f"{folder} has no glTF files; run fetch.py first")
    rows, cells = [], []
    with tempfile.TemporaryDirectory() as temporary:
        for number, path in enumerate(files):
            image = Path(temporary) / f"{number}.exr"
            result, said = render(args.program.resolve(), path, image, args.size, args.spp, args.limit)
            rows.append([path.relative_to(folder), result, said])
            cells.append(cell(image.with_suffix(".png"), short(path.relative_to(folder)), result, args.size))
            print(f"{number + 1}/{len(files)} {result:9} {path.relative_to(folder)} {said}", flush=True)
    with open(out / "results.csv", "w", newline="") as table:
        writer = csv.writer(table)
        writer.writerow(["file", "result", "message"])
        writer.writerows(rows)
    height = args.size + LABEL
    for sheet in range(0, len(cells), COLUMNS * ROWS):
        shown = cells[sheet:sheet + COLUMNS * ROWS]
        made = Image.new("RGB", (COLUMNS * args.size, -(-len(shown) // COLUMNS) * height), "black")
        for place, part in enumerate(shown):
            made.paste(part, (place % COLUMNS * args.size, place // COLUMNS * height))
        made.save(out / f"sheet-{sheet // (COLUMNS * ROWS) + 1:02}.png")
    print(", ".join(f"{count} {result}" for result, count in sorted(Counter(row[1] for row in rows).items())))
    sys.exit(int(any(row[1] in ("failed", "empty") for row in rows)))


if __name__ == "__main__":
    main()
