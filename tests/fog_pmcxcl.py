#!/usr/bin/env python3
"""Compares multiple scattering in fog with pmcxcl (Monte Carlo eXtreme for OpenCL), a program that shares no code with this one.

    apt install pocl-opencl-icd      # OpenCL on the CPU (Debian); any other OpenCL device works too
    pip install pmcxcl numpy
    cargo build --release
    python3 tests/fog_pmcxcl.py [--program PATH] [--sigma-factor 1.1] [--seeds 8]

A point lamp of 1 J stands in fog. Both programs compute the fluence at a distance from the lamp, in gates of travel time. A
unit of length is 1 m in taugate and 1 mm in pmcxcl, so both give the same numbers. There are three kinds of fog:

    isotropic    sigma_s = 1, no absorption, in all space; at 2 and 4 mean free paths from the lamp
    hg 0.8       Henyey-Greenstein with g = 0.8, sigma_s = 2, sigma_a = 0.05, in all space; at the same distances. Light scatters
                 about 40 times in the last gate
    half-space   as "isotropic", but the fog ends at a plane, one mean free path above lamp and camera

Each line shows a gate, both fluences per unit of area, their ratio, and its standard error from different seeds.

taugate: pinhole cameras of 90 degrees look in all directions. The fluence is the sum over the pixels of radiance times solid angle.
pmcxcl: a grid of voxels, so large that no photon comes back from outside within the gates. A polynomial, fitted to the voxels near
the place of the camera, gives the fluence there. pmcxcl counts the whole way through a voxel at the time when the photon leaves it.
This is too late by LAG voxels on average. LAG is the mean distance from a random point of a cube to its surface in a random
direction; scattering in the voxel is neglected. So the gates of pmcxcl begin later by this distance.

Exit code 0: all ratios differ from 1 by at most 2 % plus 2 standard errors, and each standard error is at most 1.5 %. Exit code 1:
otherwise. If pmcxcl or numpy is not installed, the script prints a note and exits with 0. With pmcxcl 0.7.5 it takes half an hour
on two cores. Set POCL_MAX_PTHREAD_COUNT=1 to keep pmcxcl on one core.
"""
import argparse
import contextlib
import ctypes
import json
import math
import os
import subprocess
import sys
import tempfile

# pmcxcl contains a copy of the C++ standard library. If this copy is loaded first, pocl shares parts of it, and fails with
# "'stdint.h' file not found". So the library of the system comes first.
try:
    ctypes.CDLL("libstdc++.so.6", ctypes.RTLD_GLOBAL)
except OSError:
    pass  # Another system, which may not need it.
# pmcxcl writes a log to file descriptor 1 and to sys.stdout. Both go nowhere here.
sys.stdout = os.fdopen(os.dup(1), "w", buffering=1)
NOWHERE = open(os.devnull, "w")
os.dup2(NOWHERE.fileno(), 1)
try:
    import numpy as np
    with contextlib.redirect_stdout(NOWHERE):
        import pmcxcl
except ImportError as error:
    print(f"skipped: {error}; install numpy and pmcxcl with pip, and an OpenCL driver (Debian: pocl-opencl-icd)")
    sys.exit(0)

# sigma_s, sigma_a, g: the fog. spp and depth: samples per pixel of each render by taugate, and the longest path in segments. photons:
# of each simulation by pmcxcl. has_surface: the fog ends at a plane.
ISOTROPIC = {"sigma_s": 1.0, "sigma_a": 0.0, "g": 0.0, "spp": 24, "depth": 64, "photons": 100_000, "has_surface": False}
FORWARD = {"sigma_s": 2.0, "sigma_a": 0.05, "g": 0.8, "spp": 40, "depth": 112, "photons": 100_000, "has_surface": False}
HALF = {**ISOTROPIC, "photons": 300_000, "has_surface": True}
NEAR, FAR = [2.5, 3.5, 4.5, 6.5, 9.5, 13.5, 20.5], [4.5, 6.5, 9.5, 12.5, 16.5, 20.5]
# Fog, its properties, and the ends of the gates per distance from the lamp.
CASES = [("isotropic", ISOTROPIC, {2.0: NEAR, 4.0: FAR}), ("hg 0.8", FORWARD, {2.0: NEAR, 4.0: FAR}), ("half-space", HALF, {2.0: NEAR})]

FIRST, LAST = 2.5, 20.5  # All gates, in steps of 1.
DEPTH = 1.0  # Of lamp and camera below the surface of the half-space.
REACH = (LAST + 4.0) / 2  # No light that went further is back within the gates.
LIGHT = 2.99792458e11  # Speed of light in mm/s.
VOXEL = 0.2  # The first light must have left the voxels of a fit before the first gate begins.
LAG = 0.4484  # In voxels; see above.
SIDE = 32  # Pixels per side of an image.


def summed(fluence, first, ends):
    """Adds up gates of width 1, the first of which begins at `first`, to wider gates."""
    edges = [round(end - first) for end in ends]
    return np.array([fluence[a:b].sum() for a, b in zip(edges, edges[1:])])


def by_pmcxcl(fog, distances, seed):
    """Fluence per gate, by distance from the lamp."""
    reach = math.ceil(REACH / VOXEL)
    void = 1  # Layers of voxels without fog. Photons end there.
    deep = round(DEPTH / VOXEL)
    width = 2 * reach + 1
    shape = (width, width, void + deep + reach) if fog["has_surface"] else (width,) * 3
    lamp = [width / 2, width / 2, void + deep if fog["has_surface"] else width / 2]
    volume = np.ones(shape, dtype=np.uint8)
    if fog["has_surface"]:
        volume[:, :, :void] = 0
    start = FIRST + LAG * VOXEL
    setup = {
        "nphoton": fog["photons"], "seed": seed, "vol": volume, "unitinmm": VOXEL,
        "prop": [[0, 0, 1, 1], [fog["sigma_a"], fog["sigma_s"], fog["g"], 1]], "isreflect": 0,
        "srctype": "isotropic", "srcpos": lamp, "srcdir": [0, 0, 1], "issrcfrom0": 1,
        "tstart": start / LIGHT, "tend": (start + LAST - FIRST) / LIGHT, "tstep": 1 / LIGHT, "outputtype": "flux", "autopilot": 1}
    with contextlib.redirect_stdout(NOWHERE):
        result = pmcxcl.run(setup)
    if "flux" not in result:
        sys.exit("pmcxcl found no OpenCL device; install a driver (Debian: pocl-opencl-icd)")
    # Centres of the voxels, seen from the lamp.
    x, y, z = np.ogrid[:shape[0], :shape[1], :shape[2]]
    x, y, z = ((axis + 0.5 - place) * VOXEL for axis, place in zip((x, y, z), lamp))
    fit = fit_in_plane if fog["has_surface"] else fit_in_space
    return {distance: summed(fit(result["flux"] / LIGHT, x, y, z, distance), FIRST, ends) for distance, ends in distances.items()}


def fit_in_space(flux, x, y, z, distance):
    """The flux at a distance from the lamp, from a parabola over the voxels of a shell."""
    radius = np.sqrt(x**2 + y**2 + z**2)
    near = abs(radius - distance) < VOXEL
    r = radius[near]
    d = r - distance
    # The means of 1, d and d^2 over the volume of each voxel.
    means = np.stack([np.ones_like(d), d + VOXEL**2 / (12 * r), d**2 + VOXEL**2 * (1 / 12 + d / (6 * r))], axis=1)
    return np.linalg.lstsq(means, flux[near].astype(float), rcond=None)[0][0]


def fit_in_plane(flux, x, y, z, distance):
    """The flux at a distance from the lamp and in its depth, from a polynomial over the voxels of a ring."""
    radius = np.sqrt(x**2 + y**2) + 0 * z
    height = 0 * radius + z
    near = (abs(radius - distance) < VOXEL) & (abs(height) < 2 * VOXEL)
    r, h = radius[near], height[near]
    d = r - distance
    means = [np.ones_like(d), d + VOXEL**2 / (24 * r), d**2 + VOXEL**2 * (1 / 12 + d / (12 * r)), h, h**2 + VOXEL**2 / 12]
    return np.linalg.lstsq(np.stack(means, axis=1), flux[near].astype(float), rcond=None)[0][0]


def by_taugate(program, fog, distance, ends, seed, folder):
    """Fluence per gate. The lamp is in the origin, and the camera on the x axis. The fog of a half-space ends at z = -DEPTH."""
    scene, output = os.path.join(folder, "lamp.gltf"), os.path.join(folder, "image.npy")
    lamp = {"type": "point", "intensity": 1 / (4 * math.pi)}
    node = {"name": "lamp", "extensions": {"KHR_lights_punctual": {"light": 0}}}
    with open(scene, "w") as file:
        json.dump({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [node],
                   "extensionsUsed": ["KHR_lights_punctual"],
                   "extensions": {"KHR_lights_punctual": {"lights": [lamp]}}}, file)
    # Directions of view, and the number of directions with the same view by symmetry.
    views = [((-1, 0, 0), 1), ((1, 0, 0), 1)]
    if fog["has_surface"]:
        views += [((0, 1, 0), 2), ((0, 0, 1), 1), ((0, 0, -1), 1)]
        size = 2 * REACH
        bounds = [f"--medium-bounds={-size},{-size},{-DEPTH},{size},{size},{size}"]
    else:
        views += [((0, 0, 1), 4)]
        bounds = []
    at = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1  # On a plane at distance 1.
    solid_angle = (2 / SIDE) ** 2 / (1 + at**2 + at[:, None] ** 2) ** 1.5
    phase = ["--phase", "hg", "--phase-g", str(fog["g"])] if fog["g"] else ["--phase", "isotropic"]
    fluence = 0
    for number, ((x, y, z), count) in enumerate(views):
        subprocess.run([
            program, "render", scene, "-o", output, "--quiet", "--estimator", "lcs",
            "--spp", str(fog["spp"]), "--seed", str(8 * seed + number), *bounds,
            "--sigma-s", str(fog["sigma_s"]), "--sigma-a", str(fog["sigma_a"]), *phase,
            f"--look-from={distance},0,0", f"--look-at={distance + x},{y},{z}", "--up", "0,0,1" if y else "0,1,0", "--fov", "90",
            "--resolution", f"{SIDE}x{SIDE}", "--max-depth", str(fog["depth"]),
            "--gates", f"{ends[0]}m..{ends[-1]}m/{round(ends[-1] - ends[0])}"], check=True)
        image = np.load(output)[..., 0].astype(float)
        fluence = fluence + count * np.einsum("yx,yxt->t", solid_angle, image)
    return summed(fluence, ends[0], ends)


def mean_and_error(samples):
    samples = np.array(samples)
    return samples.mean(axis=0), samples.std(axis=0, ddof=1) / math.sqrt(len(samples))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="target/release/taugate", help="path of taugate")
    parser.add_argument("--case", choices=[name for name, _, _ in CASES], help="only this kind of fog")
    parser.add_argument("--sigma-factor", type=float, default=1, help="multiplies sigma_s in taugate: a wrong fog must be found")
    parser.add_argument("--seeds", type=int, default=8, help="at least 2; more seeds, smaller errors")
    arguments = parser.parse_args()
    if arguments.seeds < 2:
        parser.error("--seeds must be at least 2, because the errors follow from the differences of seeds")
    if not os.access(arguments.program, os.X_OK):
        parser.error(f"there is no program '{arguments.program}'; build it with: cargo build --release")
    failed = 0
    for name, fog, distances in CASES:
        if arguments.case not in (None, name):
            continue
        theirs = [by_pmcxcl(fog, distances, seed) for seed in range(1, arguments.seeds + 1)]
        changed = {**fog, "sigma_s": fog["sigma_s"] * arguments.sigma_factor}
        for distance, ends in distances.items():
            with tempfile.TemporaryDirectory() as folder:
                ours = [by_taugate(arguments.program, changed, distance, ends, seed, folder) for seed in range(arguments.seeds)]
            print(f"{name}, distance {distance:g}")
            a, a_error = mean_and_error(ours)
            b, b_error = mean_and_error([found[distance] for found in theirs])
            ratios = a / b
            errors = ratios * np.hypot(a_error / a, b_error / b)
            for k, (ratio, error) in enumerate(zip(ratios, errors)):
                # A ratio that is not a number fails.
                agrees = abs(ratio - 1) <= 0.02 + 2 * error
                verdict = ("" if error <= 0.015 else "  too noisy") if agrees else "  differs"
                failed += verdict != ""
                print(f"  {ends[k]:4.1f}..{ends[k + 1]:4.1f}  taugate {a[k]:.4e}  pmcxcl {b[k]:.4e}  "
                      f"ratio {ratio:.4f} +- {error:.4f}{verdict}")
    print(f"{failed} gates differ or are too noisy" if failed else "all gates agree")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
