#!/usr/bin/env python3
"""Compares the error at equal time with mitransient in fog: a thin gate in the foggy Cornell box of tests/oracle_mitransient.py.

    pip install mitransient mitsuba numpy      # and a recent LLVM (Debian: libllvm19)
    cargo build --release
    python3 benches/fog_peers.py [--time 4] [--seeds 6]

Both programs use all cores and render for the same wall time. Loading and compilation are excluded. Each error is the variance between
the seeds, relative to the mean of all renders by taugate as in relMSE: once for all pixels, once without the worst 1 %. Without
mitransient it prints a message and exits with 0.
"""
import argparse
import os
import subprocess
import sys
import tempfile
import time

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
sys.path.insert(0, os.path.join(ROOT, "tests"))
import oracle_mitransient as box
from mitransient_or_skip import mi, np

box.SIZE, box.FIRST, box.LAST, box.GATES = 48, 6.2, 6.238, 1
box.WIDTH = box.LAST - box.FIRST


def by_mitransient(scene, spp, seed):
    """The image, and the seconds that it took."""
    start = time.time()
    _, frames = mi.render(scene, spp=spp, seed=seed)
    image = np.array(frames, dtype=np.float64)[:, :, 0, :3]
    return image, time.time() - start


def by_taugate(program, scene, seconds, seed):
    """The image."""
    output = os.path.join(os.path.dirname(scene), "image.exr")
    bounds = ",".join(str(x) for corner in box.FOG_BOX for x in corner)
    subprocess.run([program, "render", scene, "-o", output, "--gate", f"{box.FIRST}m..{box.LAST}m", "--estimator", "lcs",
                    "--resolution", f"{box.SIZE}x{box.SIZE}", "--time", f"{seconds}s", "--seed", str(seed), "--max-depth", "64",
                    "--sigma-s", str(box.FOG["sigma_s"]), "--sigma-a", str(box.FOG["sigma_a"]), "--phase-g", str(box.FOG["g"]),
                    f"--medium-bounds={bounds}", "--quiet"], check=True, stdout=subprocess.DEVNULL)
    return np.array(mi.Bitmap(output), dtype=np.float64)[..., :3]


def errors(images, reference):
    """Relative variances: over all pixels, and without the worst 1 %."""
    relative = images.var(axis=0, ddof=1) / (reference**2 + (0.01 * reference.mean()) ** 2)
    of_pixels = np.sort(relative.mean(axis=-1).ravel())
    return np.array([of_pixels.mean(), of_pixels[: int(0.99 * len(of_pixels))].mean()])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--binary", default="target/release/taugate")
    parser.add_argument("--time", type=float, default=4, help="seconds per render")
    parser.add_argument("--seeds", type=int, default=6, help="renders of each program, at least 2")
    arguments = parser.parse_args()
    scene = box.mitsuba_scene(fog=True)
    by_mitransient(scene, 16, 0)  # Compiles.
    short, long = by_mitransient(scene, 64, 1)[1], by_mitransient(scene, 192, 2)[1]
    spp = max(16, int(arguments.time * 128 / max(long - short, 1e-3)))
    theirs, seconds = zip(*(by_mitransient(scene, spp, 10 + seed) for seed in range(arguments.seeds)))
    with tempfile.TemporaryDirectory() as folder:
        scene = os.path.join(folder, "box.gltf")
        box.write_gltf(scene)
        by_taugate(arguments.binary, scene, 1, 0)  # Compiles.
        ours = np.array([by_taugate(arguments.binary, scene, arguments.time, 10 + seed) for seed in range(2 * arguments.seeds)])
    theirs, reference = np.array(theirs), ours.mean(axis=0)
    there, here = errors(theirs, reference), errors(ours[: arguments.seeds], reference)
    print(f"mitransient: {np.mean(seconds):.1f} s, {spp} samples per pixel, mean {theirs.mean():.4e}, "
          f"error {there[0]:.3g} ({there[1]:.3g} without the worst 1 %)")
    print(f"lcs: {arguments.time:g} s, mean {reference.mean():.4e}, error {here[0]:.3g} ({here[1]:.3g})")
    print(f"mitransient over lcs: {there[0] / here[0]:.0f} ({there[1] / here[1]:.0f} without the worst 1 %)")


if __name__ == "__main__":
    main()
