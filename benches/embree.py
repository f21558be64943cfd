#!/usr/bin/env python3
"""Compares rays per second with Embree, for the same triangles and the same rays. Prints a Markdown table.

    pip install mitsuba numpy      # and a recent LLVM (Debian: libllvm19)
    python3 benches/embree.py [--triangles 200000] [--rounds 5]

`cargo bench --bench throughput -- --rays FILE` traces rays in the cluttered room and writes them to FILE. Mitsuba's Embree then
traces the same rays on all cores, in packets as wide as the processor's vectors. Rounds alternate. The table shows medians, and the
range of the ratios. It also shows the fraction of rays that hit a triangle, which must be the same for both; a shadow ray hits if it
is blocked. Without Mitsuba the script prints a message and exits with 0.
"""
import argparse
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
sys.path.insert(0, os.path.join(ROOT, "tests"))
from mitsuba_or_skip import modules

mi, dr, np = modules("drjit", "numpy")
if not mi.MI_ENABLE_EMBREE:
    print("skipped: this Mitsuba was built without Embree")
    sys.exit(0)

# Name of the rays in the bench, in the order of its file; whether any hit is enough; whether neighbouring rays are coherent.
KINDS = [("primary", False, True), ("shadow of primary", True, True), ("bounce", False, False), ("shadow of bounce", True, False)]


def read(path):
    """Corners of the triangles (n, 3, 3), and the rays of each kind (n, 8): origin, length, direction, padding."""
    words = np.fromfile(path, np.uint32)
    at = 0

    def block(width):
        nonlocal at
        count = int(words[at])
        values = words[at + 1:at + 1 + count * width].view(np.float32).reshape(count, width)
        at += 1 + count * width
        return values

    corners = block(9).reshape(-1, 3, 3)
    return corners, [block(8) for _ in KINDS]


def scene_of(corners):
    mesh = mi.Mesh("room", 3 * len(corners), len(corners))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = corners.ravel()
    parameters["faces"] = np.arange(3 * len(corners), dtype=np.uint32)
    parameters.update()
    return mi.load_dict({"type": "scene", "room": mesh})


def ray_of(rays):
    ray = mi.Ray3f(mi.Point3f(rays[:, 0:3].T), mi.Vector3f(rays[:, 4:7].T))
    ray.maxt = mi.Float(rays[:, 3])
    dr.eval(ray)
    dr.sync_thread()
    return ray


def by_embree(scene, ray, any_hit, coherent):
    """Millions of rays per second, and the fraction that hit."""
    start = time.perf_counter()
    hit = scene.ray_test(ray, coherent=coherent) if any_hit else scene.ray_intersect_preliminary(ray, coherent).is_valid()
    dr.eval(hit)
    dr.sync_thread()
    seconds = time.perf_counter() - start
    return dr.width(hit) / seconds / 1e6, float(np.mean(hit.numpy()))


def by_taugate(triangles, file):
    command = ["cargo", "bench", "-q", "--bench", "throughput", "--", str(triangles), "--rays", file]
    text = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    return [float(re.search(rf"^{name} +device +([\d.]+) M/s", text, re.M)[1]) for name, *_ in KINDS]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--triangles", type=int, default=200_000)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "rays")
        ours, theirs = [by_taugate(options.triangles, file)], []
        corners, batches = read(file)
        scene, rays = scene_of(corners), [ray_of(batch) for batch in batches]
        embree = lambda: [by_embree(scene, ray, *kind[1:]) for ray, kind in zip(rays, KINDS)]
        # The first call builds the BVH and compiles the kernels.
        hits = [hit for _, hit in embree()]
        for number in range(options.rounds):
            if number > 0:
                ours.append(by_taugate(options.triangles, file))
            repeated = [embree() for _ in range(5)]
            theirs.append([statistics.median(once[kind][0] for once in repeated) for kind in range(len(KINDS))])
    print(f"{len(corners)} triangles, {os.cpu_count()} cores, {options.rounds} rounds\n")
    print("| rays | number | hit | taugate, M/s | Embree, M/s | taugate / Embree |")
    print("|---|---|---|---|---|---|")
    for kind, (name, *_) in enumerate(KINDS):
        mine, embree = [r[kind] for r in ours], [r[kind] for r in theirs]
        ratios = sorted(a / b for a, b in zip(mine, embree))
        print(f"| {name} | {len(batches[kind])} | {hits[kind]:.3f} | {statistics.median(mine):.1f} "
              f"| {statistics.median(embree):.1f} | {statistics.median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f}) |")


main()
