#!/usr/bin/env python3
"""Compares a scan around a corner with mitransient, a renderer that shares no code with this one.

    pip install mitransient mitsuba numpy      # and a recent LLVM (Debian: libllvm19)
    cargo build --release
    python3 tests/scan_mitransient.py

A laser lights one point of a diffuse wall, and the sensor looks at six other points of it. A diffuse rectangle, 1 m in front of the
wall, reflects the light back. Both programs measure the radiance of the six points in 16 gates, from travel times that begin and end
at the wall. All orders of reflection count. taugate reads the scene as glTF; Mitsuba gets its own shapes.

Exit code 0: every |z| is below the limit, and gates shifted by 2 cm differ by more. Exit code 1: otherwise. If mitransient is not
installed, the script prints a note and exits with 0.
"""
import argparse
import base64
import json
import os
import subprocess
import sys
import tempfile

from mitransient_or_skip import mi, mitransient, np

WALL, OBJECT = 0.7, 0.5
LASER, SENSOR = (2.5, 0.5, 2.0), (2.5, -0.5, 2.5)
LIT = (0.2, 0.3, 0.0)
COLUMNS, ROWS = 3, 2
FIRST, WIDTH, GATES = 1.9, 0.1, 16
SEEDS, LIMIT, SHIFT = 16, 4.5, 0.02
# Mitsuba's projector with a small field of view stands for the laser.
FIELD_OF_VIEW = 0.2


def seen():
    """The points that the NLOS capture meter sees: the centres of the cells of the wall, row by row from the bottom."""
    return [(2 * (i + 0.5) / COLUMNS - 1, 2 * (j + 0.5) / ROWS - 1, 0.0) for j in range(ROWS) for i in range(COLUMNS)]


def mitsuba_scene():
    film = {"type": "transient_hdr_film", "width": COLUMNS, "height": ROWS, "temporal_bins": GATES, "start_opl": FIRST,
            "bin_width_opl": WIDTH, "rfilter": {"type": "box"}}
    sensor = {"type": "nlos_capture_meter", "sensor_origin": list(SENSOR), "film": film, "sampler": {"type": "independent"}}
    transform = mi.ScalarTransform4f
    diffuse = lambda albedo: {"type": "diffuse", "reflectance": {"type": "rgb", "value": [albedo] * 3}}
    laser = {"type": "projector", "irradiance": 1.0, "fov": FIELD_OF_VIEW,
             "to_world": transform().look_at(origin=LASER, target=LIT, up=(0, 1, 0))}
    integrator = {"type": "transient_nlos_path", "nlos_laser_sampling": True, "temporal_filter": "box", "max_depth": 32,
                  "rr_depth": 8, "account_first_and_last_bounces": False}
    facing = transform().translate((0, 0, 1)).rotate((1, 0, 0), 180).scale(0.5)
    return mi.load_dict({"type": "scene", "integrator": integrator, "laser": laser,
                         "wall": {"type": "rectangle", "bsdf": diffuse(WALL), "sensor": sensor},
                         "object": {"type": "rectangle", "to_world": facing, "bsdf": diffuse(OBJECT)}})


def reference(spp):
    """Radiance by seed, gate and point of the sensor.

    With laser sampling, mitransient lights one point of the wall, and takes the irradiance of the projector there for the power that
    arrives. `power` is this number."""
    scene, found = mitsuba_scene(), []
    for seed in range(SEEDS):
        _, frames = mi.render(scene, spp=spp, seed=seed)
        frames = np.array(frames, dtype=np.float64)[..., :3].mean(axis=-1)
        found.append(frames.reshape(COLUMNS * ROWS, GATES).T)
    return np.array(found)


def write_gltf(path):
    data, views, accessors, meshes, materials = b"", [], [], [], []
    wall = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    thing = [(-0.5, -0.5, 1), (-0.5, 0.5, 1), (0.5, 0.5, 1), (0.5, -0.5, 1)]
    for name, albedo, corners in [("wall", WALL, wall), ("object", OBJECT, thing)]:
        for values, kind, code in [(np.array(corners, "<f4"), "VEC3", 5126), (np.array([0, 1, 2, 0, 2, 3], "<u4"), "SCALAR", 5125)]:
            views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
            accessor = {"bufferView": len(views) - 1, "componentType": code, "count": len(values), "type": kind}
            if kind == "VEC3":
                accessor.update(min=values.min(axis=0).tolist(), max=values.max(axis=0).tolist())
            accessors.append(accessor)
            data += values.tobytes()
        materials.append({"name": name, "pbrMetallicRoughness": {"baseColorFactor": [albedo] * 3 + [1.0], "metallicFactor": 0.0},
                          "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}}})
        primitive = {"attributes": {"POSITION": len(accessors) - 2}, "indices": len(accessors) - 1, "material": len(materials) - 1}
        meshes.append({"name": name, "primitives": [primitive]})
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    document = {"asset": {"version": "2.0"}, "extensionsUsed": ["KHR_materials_specular"], "scene": 0, "scenes": [{"nodes": [0, 1]}],
                "nodes": [{"name": mesh["name"], "mesh": i} for i, mesh in enumerate(meshes)], "meshes": meshes,
                "materials": materials, "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(data), "uri": uri}]}
    with open(path, "w") as file:
        json.dump(document, file)


def ours(binary, folder, estimator, spp, shift):
    """Radiance of taugate's scan by seed, gate and point of the sensor, through gates moved by `shift` metres."""
    scan, out, found = os.path.join(folder, "scan.toml"), os.path.join(folder, "scan.npy"), []
    first = FIRST + shift
    with open(scan, "w") as file:
        file.write(f'scene = "corner.gltf"\n[scan]\nlaser = {list(LASER)}\nsensor = {list(SENSOR)}\npower = 1\n'
                   f"laser-points = [{list(LIT)}]\nsensor-points = {[list(point) for point in seen()]}\n"
                   f'[gate]\ngates = "{first!r}m..{first + WIDTH * GATES!r}m/{GATES}"\n')
    for seed in range(SEEDS):
        subprocess.run([binary, "render", scan, "-o", out, "--estimator", estimator, "--spp", str(spp), "--seed", str(1000 * seed),
                        "--max-depth", "32", "--quiet"], check=True, stdout=subprocess.DEVNULL)
        found.append(np.load(out)[:, 0, :])
    return np.array(found, dtype=np.float64)


def power():
    """Power in W that the projector brings to the lit point: pi times its irradiance, times the cosine over the squared distance."""
    to_lit = np.subtract(LASER, LIT)
    return np.pi * to_lit[2] / np.linalg.norm(to_lit) / to_lit.dot(to_lit)


def greatest_z(a, b):
    error = np.sqrt(a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b))
    # Gates before the first light are black in both programs.
    lit = b.mean(axis=0) > 1e-4 * b.mean(axis=0).max()
    z = ((a.mean(axis=0) - b.mean(axis=0)) / np.maximum(error, 1e-12))[lit]
    return np.abs(z).max(), z


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--binary", default="target/release/taugate")
    parser.add_argument("--estimator", default="lcs")
    arguments = parser.parse_args()
    there = reference(1 << 20) / power()
    with tempfile.TemporaryDirectory() as folder:
        write_gltf(os.path.join(folder, "corner.gltf"))
        here = ours(arguments.binary, folder, arguments.estimator, 32768, 0.0)
        shifted = ours(arguments.binary, folder, arguments.estimator, 4096, SHIFT)
    worst, z = greatest_z(here, there)
    apart, _ = greatest_z(shifted, there)
    print("| travel time | taugate / mitransient | error |\n|---|---|---|")
    for first in range(0, GATES, 4):
        a, b = (x[:, first:first + 4].mean(axis=(1, 2)) for x in (here, there))
        ratio = a.mean() / b.mean()
        error = ratio * np.hypot(a.std(ddof=1) / a.mean(), b.std(ddof=1) / b.mean()) / np.sqrt(SEEDS)
        print(f"| {FIRST + WIDTH * first:.1f} to {FIRST + WIDTH * (first + 4):.1f} m | {ratio:.4f} | {error:.4f} |")
    print(f"{arguments.estimator} against mitransient {mitransient.__version__}, {z.size} values: ratio of means "
          f"{here.mean() / there.mean():.4f}, greatest |z| {worst:.2f}, rms z {np.sqrt((z ** 2).mean()):.2f}; gates shifted by "
          f"{100 * SHIFT:.0f} cm: greatest |z| {apart:.1f}")
    sys.exit(0 if worst < LIMIT < apart else 1)


main()
