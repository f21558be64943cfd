#!/usr/bin/env python3
"""Compares the error at equal time with mitransient, a transient renderer that shares no code with taugate. Prints a Markdown page.

    pip install mitransient mitsuba numpy      # and a recent LLVM (Debian: libllvm19)
    cargo build --release
    python3 benches/peers.py [--time 20] [--size 96] [--repetitions 3] > peers.md

Scenes: the Cornell box and, if the shared scenes are on this machine, staircase, both with their area lights. The programs have
different materials, so both render the same simplified scene from a temporary folder: diffuse surfaces with their base colour (the
mean of a texture), flat normals, no transparency. The programs take turns, use all cores and render for the same wall time. Loading,
the BVH and compilation are excluded; mitransient first renders one pass that is discarded. In both programs travel times run from the
light to the pinhole. Mitsuba starts its rays on the near plane, so this plane is moved to 1e-4.

The reference is a weighted mean of two renders with different seeds, one by each program. Each takes --reference times the time of a
result. The weights are the inverse relMSE of each render. That of taugate's comes from its independent batches, that of mitransient's
from the difference between both. The page states the relMSE of the reference itself, and warns if a result is less than 20 times
above it. Both renders must agree: Welch's test compares the means of cells of 16 x 16 pixels in independent batches, with Sidak's
threshold at 1e-3. If they differ, the page says so and the script exits with 1. Without mitransient it prints a message and exits
with 0.
"""
import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from statistics import NormalDist

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
sys.path.insert(0, os.path.join(ROOT, "tests"))
import glb
from mitransient_or_skip import mi, mitransient, np

SHARED = os.environ.get("TAUGATE_SHARED_SCENES", os.path.join(ROOT, "../shared/scenes"))
# Name, file, gate in metres.
SCENES = [
    ("cornell", os.path.join(ROOT, "scenes/cornell-box.glb"), (8.0, 8.1)),
    ("staircase", os.path.join(SHARED, "staircase/scene.glb"), (12.917, 13.0599)),
]
ESTIMATORS = ("pt", "bdpt", "lcs-paper", "lcs")
PEER = "mitransient"
MAX_DEPTH = 24
MARGIN = 20.0
CELL = 16
# Number of independent renders in taugate's half of the reference.
BATCHES = 16
SIGNIFICANCE = 1e-3
COMPONENTS = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


def mean_colour(document, binary, texture, folder):
    """Mean linear RGB of a texture."""
    image = document["images"][document["textures"][texture]["source"]]
    if "bufferView" not in image:
        sys.exit("peers.py reads only textures that are inside the scene file; embed the textures")
    view = document["bufferViews"][image["bufferView"]]
    start = view.get("byteOffset", 0)
    path = os.path.join(folder, "texture" + {"image/png": ".png", "image/jpeg": ".jpg"}[image["mimeType"]])
    with open(path, "wb") as file:
        file.write(binary[start:start + view["byteLength"]])
    linear = mi.Bitmap(path).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    return np.array(linear, dtype=np.float64).mean(axis=(0, 1))


def simplified(document, binary, folder):
    """The scene with diffuse materials and flat normals. Surfaces are double-sided unless they emit."""
    for material in document["materials"]:
        old = material.get("pbrMetallicRoughness", {})
        textured = old.get("baseColorTexture")
        texture = [1.0] * 3 if textured is None else mean_colour(document, binary, textured["index"], folder)
        colour = [float(t * c) for t, c in zip(texture, old.get("baseColorFactor", [1.0] * 4)[:3])]
        emissive = any(material.get("emissiveFactor", [0.0]))
        strength = material.get("extensions", {}).get("KHR_materials_emissive_strength")
        extensions = {"KHR_materials_specular": {"specularFactor": 0.0}}
        if strength:
            extensions["KHR_materials_emissive_strength"] = strength
        kept = {key: material[key] for key in ("name", "emissiveFactor") if key in material}
        material.clear()
        material.update(kept, doubleSided=not emissive, extensions=extensions,
                        pbrMetallicRoughness={"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0})
    for mesh in document["meshes"]:
        for primitive in mesh["primitives"]:
            primitive["attributes"] = {"POSITION": primitive["attributes"]["POSITION"]}
    for unused in ("images", "textures", "samplers"):
        document.pop(unused, None)
    document["extensionsUsed"] = ["KHR_materials_specular", "KHR_materials_emissive_strength"]
    return document


def accessor(document, binary, index):
    a = document["accessors"][index]
    view = document["bufferViews"][a["bufferView"]]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[a["type"]]
    if "byteStride" in view:
        sys.exit("peers.py reads only tightly packed accessors; export the scene without interleaving")
    start = view.get("byteOffset", 0) + a.get("byteOffset", 0)
    values = np.frombuffer(binary, COMPONENTS[a["componentType"]], a["count"] * width, start)
    return values.reshape(-1, width)


def node_matrix(node):
    if node.get("children"):
        sys.exit("peers.py reads only scenes whose nodes have no children; flatten the hierarchy")
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", [0.0, 0.0, 0.0, 1.0])
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                               [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                               [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    matrix[:3, :3] *= np.array(node.get("scale", [1.0, 1.0, 1.0]))
    matrix[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return matrix


def mitsuba_scene(document, binary, size, gate, bins=1):
    camera = next(node for node in document["nodes"] if "camera" in node)
    view = node_matrix(camera)
    eye, ahead, up = view[:3, 3], -view[:3, 2], view[:3, 1]
    fov = np.degrees(document["cameras"][camera["camera"]]["perspective"]["yfov"])
    film = {"type": "transient_hdr_film", "width": size[0], "height": size[1], "temporal_bins": bins, "start_opl": gate[0],
            "bin_width_opl": (gate[1] - gate[0]) / bins, "rfilter": {"type": "box"}}
    to_world = mi.ScalarTransform4f().look_at(origin=eye.tolist(), target=(eye + ahead).tolist(), up=up.tolist())
    sensor = {"type": "perspective", "fov": float(fov), "fov_axis": "y", "near_clip": 1e-4, "far_clip": 1000.0,
              "to_world": to_world, "film": film, "sampler": {"type": "independent"}}
    integrator = {"type": "transient_path", "max_depth": MAX_DEPTH, "rr_depth": 5, "camera_unwarp": False,
                  "temporal_filter": "box"}
    scene = {"type": "scene", "integrator": integrator, "sensor": sensor}
    for number, node in enumerate(n for n in document["nodes"] if "mesh" in n):
        matrix = node_matrix(node)
        for part, primitive in enumerate(document["meshes"][node["mesh"]]["primitives"]):
            corners = accessor(document, binary, primitive["attributes"]["POSITION"]).astype(float)
            corners = corners @ matrix[:3, :3].T + matrix[:3, 3]
            faces = accessor(document, binary, primitive["indices"]).ravel().astype("<u4")
            name = f"mesh_{number}_{part}"
            scene[name] = mitsuba_mesh(name, corners, faces, document["materials"][primitive["material"]])
    return mi.load_dict(scene)


def mitsuba_mesh(name, corners, faces, material):
    colour = material["pbrMetallicRoughness"]["baseColorFactor"][:3]
    diffuse = {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour}}
    properties = mi.Properties()
    emission = np.array(material.get("emissiveFactor", [0.0] * 3))
    if emission.any():
        strength = material["extensions"].get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        radiance = {"type": "rgb", "value": (strength * emission).tolist()}
        properties["bsdf"] = mi.load_dict(diffuse)
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": radiance})
    else:
        properties["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": diffuse})
    mesh = mi.Mesh(name, len(corners), len(faces) // 3, has_vertex_normals=False, props=properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = corners.astype(np.float32).ravel()
    parameters["faces"] = faces
    parameters.update()
    return mesh


class Peer:
    """mitransient, which renders in passes of about a sixteenth of the time."""

    def __init__(self, scene):
        self.scene, self.pass_spp = scene, 1
        self.render_pass(1)

    def render_pass(self, seed):
        _, frames = mi.render(self.scene, spp=self.pass_spp, seed=seed)
        return np.array(frames, dtype=np.float64)[:, :, 0, :3]

    def tune(self, seconds):
        """Doubles the samples of a pass until it is long enough. This also compiles the kernels of that size."""
        while True:
            self.render_pass(2)
            start = time.perf_counter()
            self.render_pass(3)
            spent = time.perf_counter() - start
            if spent >= seconds / 32 or self.pass_spp >= 1024:
                return
            self.pass_spp *= 2

    def render(self, seconds, seed):
        """Returns the image, the seconds, the samples per pixel, and the means over cells for every pass."""
        self.tune(seconds)
        total, batches, start = 0.0, [], time.perf_counter()
        while time.perf_counter() - start < seconds:
            image = self.render_pass(1000 * seed + len(batches))
            total = total + image
            batches.append(cells(image))
        return total / len(batches), time.perf_counter() - start, len(batches) * self.pass_spp, np.array(batches)


def ours(binary, scene, estimator, size, gate, seconds, seed, folder):
    out, stats = os.path.join(folder, "out.exr"), os.path.join(folder, "out.json")
    subprocess.run([binary, "render", scene, "-o", out, "--gate", f"{gate[0]!r}m..{gate[1]!r}m", "--estimator", estimator,
                    "--resolution", f"{size[0]}x{size[1]}", "--time", f"{seconds}s", "--seed", str(seed), "--max-depth",
                    str(MAX_DEPTH), "--stats", stats, "--quiet"], check=True, stdout=subprocess.DEVNULL)
    with open(stats) as file:
        numbers = json.load(file)
    return np.array(mi.Bitmap(out), dtype=np.float64)[..., :3], numbers


def relmse(image, reference):
    """Returns the relMSE over all pixels, and without the worst 1 % of the pixels."""
    eps = (0.01 * reference.mean()) ** 2
    pixels = np.sort(((image - reference) ** 2 / (reference ** 2 + eps)).mean(axis=-1), axis=None)
    return float(pixels.mean()), float(pixels[:len(pixels) - len(pixels) // 100].mean())


def weighted_reference(batches, other):
    """Returns the mean of two renders, weighted by their inverse relMSE, and its own relMSE. `batches` are independent images whose
    mean is the first render, `other` is the second one."""
    first = np.mean(batches, axis=0)
    scale = 0.5 * (first + other)
    eps = (0.01 * scale.mean()) ** 2
    weight = 1.0 / (scale ** 2 + eps)
    of_first = float((np.var(batches, axis=0, ddof=1) * weight).mean()) / len(batches)
    of_other = max(float(((first - other) ** 2 * weight).mean()) - of_first, of_first)
    total = of_first + of_other
    return (of_other * first + of_first * other) / total, of_first * of_other / total


def cells(image):
    """Means over cells of CELL x CELL pixels; cells at the edges may be smaller."""
    rows, columns = range(0, image.shape[0], CELL), range(0, image.shape[1], CELL)
    return np.array([image[y:y + CELL, x:x + CELL].mean(axis=(0, 1)) for y in rows for x in columns])


def agreement(a, b):
    """Compares two renders. Returns the largest |z| of the means over cells, the threshold, the number of means, the ratio of the
    image means and its error. `a` and `b` have the shape (batch, cell, channel). Cells with an error above 10 % are merged into one."""
    means, errors = [x.mean(axis=0) for x in (a, b)], [x.std(axis=0, ddof=1) / math.sqrt(len(x)) for x in (a, b)]
    noisy = (np.maximum(*errors) > 0.05 * (means[0] + means[1])).any(axis=1)
    groups = [[cell] for cell in np.flatnonzero(~noisy)] + ([np.flatnonzero(noisy)] if noisy.any() else [])
    worst, freedom = 0.0, math.inf
    for group in groups:
        x, y = a[:, group].mean(axis=1), b[:, group].mean(axis=1)
        parts = [x.var(axis=0, ddof=1) / len(x), y.var(axis=0, ddof=1) / len(y)]
        both = parts[0] + parts[1]
        lit = both > 0.0
        worst = max(worst, float((np.abs(x.mean(axis=0) - y.mean(axis=0))[lit] / np.sqrt(both[lit])).max(initial=0.0)))
        degrees = both[lit] ** 2 / (parts[0][lit] ** 2 / (len(x) - 1) + parts[1][lit] ** 2 / (len(y) - 1))
        freedom = min(freedom, float(degrees.min(initial=math.inf)))
    tests = 3 * len(groups)
    z = NormalDist().inv_cdf(0.5 + 0.5 * (1.0 - SIGNIFICANCE) ** (1.0 / tests))
    # Student's t (Fisher's expansion).
    threshold = z + (z ** 3 + z) / (4 * freedom) + (5 * z ** 5 + 16 * z ** 3 + 3 * z) / (96 * freedom ** 2)
    whole = [x.mean(axis=(1, 2)) for x in (a, b)]
    relative = [x.std(ddof=1) / math.sqrt(len(x)) / x.mean() for x in whole]
    ratio = whole[0].mean() / whole[1].mean()
    return worst, threshold, tests, ratio, ratio * math.hypot(*relative)


def spread(values):
    return f"{np.median(values):.3g} ({min(values):.3g} to {max(values):.3g})"


def compare(arguments, name, path, gate, folder):
    document, binary = glb.read(path)
    document = simplified(document, binary, folder)
    aspect = document["cameras"][0]["perspective"].get("aspectRatio", 1.0)
    size = (max(1, round(arguments.size * min(1.0, aspect))), max(1, round(arguments.size / max(1.0, aspect))))
    scene = os.path.join(folder, f"{name}.glb")
    glb.write(scene, document, binary)
    peer = Peer(mitsuba_scene(document, binary, size, gate))

    long = arguments.reference * arguments.time
    renders = [ours(arguments.binary, scene, arguments.judge, size, gate, long / BATCHES, 901 + i, folder)[0]
               for i in range(BATCHES)]
    half_b, _, _, passes = peer.render(long, 902)
    worst, threshold, tests, ratio, error = agreement(np.array([cells(image) for image in renders]), passes)
    reference, own = weighted_reference(renders, half_b)

    errors, samples, spent = {}, {}, {}
    for repetition in range(arguments.repetitions):
        for estimator in (*ESTIMATORS, PEER):
            if estimator == PEER:
                image, seconds, spp, _ = peer.render(arguments.time, 1 + repetition)
            else:
                image, numbers = ours(arguments.binary, scene, estimator, size, gate, arguments.time, 1 + repetition, folder)
                seconds, spp = numbers["render_seconds"], numbers["samples_per_pixel"]
            errors.setdefault(estimator, []).append(relmse(image, reference))
            samples.setdefault(estimator, []).append(spp)
            spent.setdefault(estimator, []).append(seconds)

    print(f"\n## {name}\n\n{size[0]} x {size[1]} pixels, gate {gate[0]} m to {gate[1]} m. Reference: {long:g} s by {arguments.judge} and "
          f"{long:g} s by {PEER}, ratio of their means {ratio:.4f} +- {error:.4f}, own relMSE {own:.2e}. The largest |z| of {tests} "
          f"means of cells is {worst:.2f}; {threshold:.2f} is significant.\n")
    print("| renderer | seconds | samples per pixel | relMSE | times lower than mitransient's | relMSE without the worst 1 % | times "
          "lower |\n|---|---|---|---|---|---|---|")
    for estimator in (*ESTIMATORS, PEER):
        columns = []
        for mine, theirs in zip(zip(*errors[estimator]), zip(*errors[PEER])):
            columns += [spread(mine), spread([b / a for a, b in zip(mine, theirs)])]
        print(f"| {estimator} | {np.median(spent[estimator]):.1f} | {np.median(samples[estimator]):.0f} | {' | '.join(columns)} |")
    best = min(whole for of_estimator in errors.values() for whole, _ in of_estimator)
    if own * MARGIN > best:
        print(f"\nThe relMSE of the reference itself is only {best / own:.1f} times lower than the best result, instead of "
              f"{MARGIN:.0f} times. So the ratios above are too near 1; raise --reference.")
    if worst > threshold:
        print("\nThe images of the two programs differ, so the numbers above cannot be compared.")
    return worst <= threshold


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--binary", default=os.path.join(ROOT, "target/release/taugate"))
    parser.add_argument("--time", type=float, default=20.0, help="seconds per renderer and repetition")
    parser.add_argument("--size", type=int, default=96, help="pixels of the longer side")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--reference", type=float, default=20.0, help="time of each half of the reference, in units of --time")
    parser.add_argument("--judge", default="bdpt", help="estimator of taugate's half of the reference")
    parser.add_argument("--scene", action="append", help="cornell or staircase (may be repeated); default: all that are on this machine")
    arguments = parser.parse_args()
    version = subprocess.run([arguments.binary, "--version"], check=True, capture_output=True, text=True).stdout.strip()
    print(f"# peers\n\n{version}, mitransient {mitransient.__version__}, mitsuba {mi.__version__} (llvm_ad_rgb, transient_path, "
          f"max_depth {MAX_DEPTH}, rr_depth 5, box filters), {os.cpu_count()} cores. Each renders for {arguments.time:g} s, in turns, in "
          f"{arguments.repetitions} repetitions. Numbers are medians, with minimum and maximum in brackets. All surfaces are diffuse. "
          "relMSE: mean of (x - r)^2 / (r^2 + eps), eps = (1 % of the mean of r)^2.")
    wanted = arguments.scene or [name for name, _, _ in SCENES]
    unknown = [name for name in wanted if name not in [known for known, _, _ in SCENES]]
    if unknown:
        sys.exit(f"no scene is called {unknown[0]}; choose cornell or staircase")
    agree = True
    with tempfile.TemporaryDirectory() as folder:
        for name, path, gate in (scene for scene in SCENES if scene[0] in wanted):
            if os.path.exists(path):
                agree = compare(arguments, name, path, gate, folder) and agree
            else:
                print(f"\nskipped {name}: {path} is not on this machine")
    sys.exit(0 if agree else 1)


if __name__ == "__main__":
    main()
