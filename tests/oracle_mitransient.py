#!/usr/bin/env python3
"""Compares time-gated images with mitransient, a renderer that shares no code with this one.

    pip install mitransient mitsuba numpy      # and a recent LLVM (Debian: libllvm19)
    cargo build --release
    python3 tests/oracle_mitransient.py [--estimator lcs-paper] [--fog] [--effort 10]

The scene is a diffuse Cornell box with an area light, described once below. taugate reads it as glTF, Mitsuba as meshes.
Both measure travel times from the light to the pinhole in metres. Mitsuba starts its rays on the near plane, so the script
moves the near plane to 1e-4. The script compares sixteen gates in cells of 8 x 8 pixels, with variances from independent
seeds of both renderers. With --fog, homogeneous fog fills the box, and the script compares four of the gates.

Exit code 0: every |z| is below 4, and gates shifted by 2 % of the range differ by more. With --fog, the means of both
renderers must also agree within 4 standard errors, which are at most 1.5 %. Exit code 1: otherwise. If mitransient is not
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

SIZE, CELL, SEEDS = 24, 8, 32
FIRST, LAST, GATES = 5.0, 9.0, 16
WIDTH = (LAST - FIRST) / GATES
LIMIT = 4.0
# The fog stays off the walls, because Mitsuba bounds it by a mesh. The light is inside: from a light 1 cm outside, Mitsuba 3.9.1
# loses half of the light that scatters near it (taugate agrees with a quadrature there).
FOG_BOX = ((-0.99, 0.01, -0.99), (0.99, 1.99, 0.99))
FOG = {"sigma_s": 0.45, "sigma_a": 0.05, "g": 0.5}
EYE, FIELD_OF_VIEW, RADIANCE = (0.0, 1.0, 3.9), 37.5, 12.0


def quad(corner, u, v):
    c, u, v = (np.array(x, dtype=float) for x in (corner, u, v))
    return np.array([c, c + u, c + u + v, c + v])


def box(low, high):
    (x0, y0, z0), (x1, y1, z1) = low, high
    w, h, d = x1 - x0, y1 - y0, z1 - z0
    return [quad((x0, y0, z1), (w, 0, 0), (0, h, 0)), quad((x1, y0, z0), (-w, 0, 0), (0, h, 0)),
            quad((x0, y0, z0), (0, 0, d), (0, h, 0)), quad((x1, y0, z1), (0, 0, -d), (0, h, 0)),
            quad((x0, y1, z1), (w, 0, 0), (0, 0, -d)), quad((x0, y0, z0), (w, 0, 0), (0, 0, d))]


# Name, reflectance, and quads. Seen from the front, the corners of a quad are in counter-clockwise order.
OBJECTS = [
    ("white", (0.73, 0.73, 0.73), [quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)), quad((-1, 2, -1), (2, 0, 0), (0, 0, 2)),
                                   quad((-1, 0, -1), (2, 0, 0), (0, 2, 0))]),
    ("red", (0.63, 0.06, 0.05), [quad((-1, 0, 1), (0, 0, -2), (0, 2, 0))]),
    ("green", (0.14, 0.45, 0.09), [quad((1, 0, -1), (0, 0, 2), (0, 2, 0))]),
    ("blocks", (0.6, 0.6, 0.7), box((-0.7, 0, -0.7), (-0.1, 1.2, -0.1)) + box((0.15, 0, 0.05), (0.7, 0.6, 0.6))),
    ("light", (0.0, 0.0, 0.0), [quad((-0.25, 1.98, -0.25), (0.5, 0, 0), (0, 0, 0.5))]),
]


def write_gltf(path):
    data, views, accessors, meshes, materials = b"", [], [], [], []
    for name, color, quads in OBJECTS:
        for values, kind, code in ((np.concatenate(quads).astype("<f4"), "VEC3", 5126), (triangles(quads), "SCALAR", 5125)):
            views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
            accessor = {"bufferView": len(views) - 1, "componentType": code, "count": values.size // (3 if kind == "VEC3" else 1),
                        "type": kind}
            if kind == "VEC3":
                accessor.update(min=values.min(axis=0).tolist(), max=values.max(axis=0).tolist())
            accessors.append(accessor)
            data += values.tobytes()
        material = {"name": name, "pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0},
                    "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}}}
        if name == "light":
            material["emissiveFactor"] = [1.0, 1.0, 1.0]
            material["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": RADIANCE}
        materials.append(material)
        primitive = {"attributes": {"POSITION": len(accessors) - 2}, "indices": len(accessors) - 1, "material": len(materials) - 1}
        meshes.append({"name": name, "primitives": [primitive]})
    camera = {"type": "perspective", "perspective": {"yfov": float(np.radians(FIELD_OF_VIEW)), "aspectRatio": 1.0, "znear": 0.01}}
    nodes = [{"name": m["name"], "mesh": i} for i, m in enumerate(meshes)]
    nodes.append({"name": "camera", "camera": 0, "translation": list(EYE)})
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    used = ["KHR_materials_specular", "KHR_materials_emissive_strength"]
    document = {"asset": {"version": "2.0"}, "extensionsUsed": used, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}],
                "nodes": nodes, "meshes": meshes, "materials": materials, "cameras": [camera], "accessors": accessors,
                "bufferViews": views, "buffers": [{"byteLength": len(data), "uri": uri}]}
    with open(path, "w") as file:
        json.dump(document, file)


def triangles(quads):
    return np.concatenate([4 * i + np.array([0, 1, 2, 0, 2, 3]) for i in range(len(quads))]).astype("<u4")


def mitsuba_fog():
    low, high = (np.array(corner) for corner in FOG_BOX)
    extinction = FOG["sigma_s"] + FOG["sigma_a"]
    medium = {"type": "homogeneous", "sigma_t": extinction, "albedo": FOG["sigma_s"] / extinction,
              "phase": {"type": "hg", "g": FOG["g"]}}
    place = mi.ScalarTransform4f().translate((low + high) / 2).scale((high - low) / 2)
    return {"type": "cube", "to_world": place, "bsdf": {"type": "null"}, "interior": medium}


def mitsuba_scene(fog):
    film = {"type": "transient_hdr_film", "width": SIZE, "height": SIZE, "temporal_bins": GATES, "start_opl": FIRST,
            "bin_width_opl": WIDTH, "rfilter": {"type": "box"}}
    view = mi.ScalarTransform4f().look_at(origin=EYE, target=(EYE[0], EYE[1], 0.0), up=(0, 1, 0))
    sensor = {"type": "perspective", "fov": FIELD_OF_VIEW, "fov_axis": "y", "near_clip": 1e-4, "far_clip": 100.0,
              "to_world": view, "film": film, "sampler": {"type": "independent"}}
    integrator = {"type": "transient_path", "max_depth": 64, "rr_depth": 5, "camera_unwarp": False, "temporal_filter": "box"}
    if fog:
        integrator = {"type": "transient_prbvolpath", "max_depth": 64, "rr_depth": 5, "camera_unwarp": False}
    scene = {"type": "scene", "integrator": integrator, "sensor": sensor}
    for name, color, quads in OBJECTS:
        corners, faces = np.concatenate(quads), triangles(quads)
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": list(color)}})
        if name == "light":
            emitter = mi.load_dict({"type": "area", "radiance": {"type": "rgb", "value": [RADIANCE] * 3}})
            properties["emitter"] = emitter
        mesh = mi.Mesh(name, len(corners), len(faces) // 3, has_vertex_normals=False, props=properties)
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = corners.astype(np.float32).ravel()
        parameters["faces"] = faces
        parameters.update()
        scene[name] = mesh
    if fog:
        scene["fog"] = mitsuba_fog()
    return mi.load_dict(scene)


def cells(image):
    """Means over the pixels and channels of each cell of an image: (row, column)."""
    n = SIZE // CELL
    return image.mean(axis=-1).reshape(n, CELL, n, CELL).mean(axis=(1, 3))


def reference(gates, fog, effort):
    """Cells of Mitsuba's images: (seed, gate, row, column)."""
    scene, found = mitsuba_scene(fog), []
    for seed in range(SEEDS):
        _, frames = mi.render(scene, spp=256 * effort, seed=seed)
        frames = np.array(frames, dtype=np.float64)[..., :3]
        found.append([cells(frames[:, :, gate]) for gate in gates])
    return np.array(found)


def ours(binary, scene, estimator, gates, shift, fog, effort):
    """Cells of taugate's images through the gates moved by `shift` metres: (seed, gate, row, column)."""
    found, medium = [], []
    if fog:
        bounds = ",".join(str(x) for corner in FOG_BOX for x in corner)
        medium = ["--sigma-s", str(FOG["sigma_s"]), "--sigma-a", str(FOG["sigma_a"]), "--phase-g", str(FOG["g"])]
        medium += ["--medium-bounds", bounds]
    for seed in range(SEEDS):
        row = []
        for gate in gates:
            low = FIRST + WIDTH * gate + shift
            out = os.path.join(os.path.dirname(scene), "out.exr")
            subprocess.run([binary, "render", scene, "-o", out, "--gate", f"{low!r}m..{low + WIDTH!r}m", "--estimator", estimator,
                            "--resolution", f"{SIZE}x{SIZE}", "--spp", str(32 * effort), "--seed", str(seed), "--light-paths", "4000",
                            "--max-depth", "64", "--quiet", *medium], check=True, stdout=subprocess.DEVNULL)
            row.append(cells(np.array(mi.Bitmap(out), dtype=np.float64)[..., :3]))
        found.append(row)
    return np.array(found)


def greatest_z(a, b):
    error = np.sqrt(a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b))
    z = (a.mean(axis=0) - b.mean(axis=0)) / np.maximum(error, 1e-12)
    return np.abs(z).max(), z


def relative_error(images):
    """Relative standard error of the mean over all seeds, gates and cells."""
    of_seeds = images.reshape(len(images), -1).mean(axis=1)
    return of_seeds.std(ddof=1) / len(of_seeds) ** 0.5 / of_seeds.mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--binary", default="target/release/taugate")
    parser.add_argument("--estimator", default="lcs-paper")
    parser.add_argument("--fog", action="store_true")
    parser.add_argument("--effort", type=int, default=1, help="factor of the samples per pixel of both renderers")
    arguments = parser.parse_args()
    gates = range(1, GATES, 4) if arguments.fog else range(GATES)
    there = reference(gates, arguments.fog, arguments.effort)
    with tempfile.TemporaryDirectory() as folder:
        scene = os.path.join(folder, "box.gltf")
        write_gltf(scene)
        here = ours(arguments.binary, scene, arguments.estimator, gates, 0.0, arguments.fog, arguments.effort)
        shifted = ours(arguments.binary, scene, arguments.estimator, gates, 0.02 * (LAST - FIRST),
                       arguments.fog, arguments.effort)
    worst, z = greatest_z(here, there)
    apart, _ = greatest_z(shifted, there)
    ratio = here.mean() / there.mean()
    error = ratio * np.hypot(relative_error(here), relative_error(there))
    print(f"{arguments.estimator} against mitransient {mitransient.__version__}{', in fog' if arguments.fog else ''}, {z.size} cells of {len(gates)} gates: ratio of means "
          f"{ratio:.4f} +- {error:.4f}, greatest |z| {worst:.2f}, rms z {np.sqrt((z ** 2).mean()):.2f}; gates shifted by 2 %: greatest |z| {apart:.1f}")
    same_mean = not arguments.fog or abs(ratio - 1.0) < LIMIT * error < 0.015
    sys.exit(0 if worst < LIMIT < apart and same_mean else 1)


if __name__ == "__main__":
    main()
