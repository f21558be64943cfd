#!/usr/bin/env python3
"""Compares taugate with Blender's renderer Cycles on scenes that are built in Blender and exported as glTF.

    pip install numpy pillow OpenEXR bpy==5.0.1           # Python 3.11
    cargo build --release
    python3 benches/corpus/against_cycles.py [--program target/release/taugate] [--keep FOLDER] [NAME...]
    python3 benches/corpus/against_cycles.py --picture docs/pictures/from-blender.png

Every scene has a floor, a sphere and a cube, and is exported as docs/GUIDE.md recommends. Cycles renders it with plain GGX lobes
and without shortcuts (clamping, blurred reflections, light threshold). The table gives taugate / Cycles for each object: the
median over cells of 4 x 4 pixels, and the range that holds the middle 90 % of the cells. Cells at edges of objects, and cells
darker than 2 % of the object's median, are left out. Exits with 1 if a median is off by more than 3 % although both programs have
the same material model.
"""
import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR

import bpy
import made

ROOT = Path(__file__).resolve().parents[2]
SIZE, CELL, LIMIT = 128, 4, 0.03
OBJECTS = ("floor", "sphere", "cube")


def diffuse():
    return [made.diffuse("white", made.WHITE), made.diffuse("blue", made.BLUE), made.diffuse("gold", made.GOLD)]


def metal():
    return [made.diffuse("white", made.WHITE), made.material("gold metal", Base_Color=made.GOLD, Metallic=1.0, Roughness=0.5),
            made.material("steel", Base_Color=made.WHITE, Metallic=1.0, Roughness=0.5)]


def textured_roughness():
    floor = made.material("varied", Base_Color=made.WHITE, Metallic=1.0)
    pixels = made.checker(64, 8, (0, 0.4, 0), (0, 0.8, 0))
    made.textured(floor, made.image("roughness", pixels, False), "Color", "Roughness", "ShaderNodeSeparateColor")
    return [floor, *diffuse()[1:]]


def textured_color():
    # Many small texels: Cycles interpolates before it decodes sRGB, while glTF demands the opposite.
    floor = made.diffuse("checker", made.WHITE)
    return [made.textured(floor, made.image("checker", made.checker(512))), *diffuse()[1:]]


def normal_map():
    floor = made.diffuse("bumps", made.WHITE)
    made.textured(floor, made.image("normals", made.bumps(), False), "Color", "Normal", "ShaderNodeNormalMap")
    return [floor, *diffuse()[1:]]


def plastic():
    return [made.material(f"plastic {roughness}", Base_Color=color, Roughness=roughness)
            for color, roughness in ((made.WHITE, 0.8), (made.BLUE, 0.4), (made.GOLD, 0.6))]


# For each scene: a function that returns the materials of floor, sphere and cube; the light; whether both renderers have the same
# material model.
SCENES = [(diffuse, "point", True), (diffuse, "spot", True), (diffuse, "area", True), (metal, "point", True), (metal, "area", True),
          (textured_color, "area", True), (textured_roughness, "area", True), (normal_map, "area", True),
          (plastic, "area", False)]


def objects_seen():
    """For each pixel, the number of the object at its centre, from 1; 0 for another object or none. Row 0 is at the top."""
    blender, eye = bpy.context.scene, bpy.context.scene.camera
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    corners = [np.array(corner) for corner in eye.data.view_frame(scene=blender)]
    left, right, top, bottom, ahead = corners[2][0], corners[0][0], corners[0][1], corners[1][1], corners[0][2]
    matrix = np.array(eye.matrix_world)
    seen = np.zeros((SIZE, SIZE), int)
    for y, x in np.ndindex(seen.shape):
        u, v = (x + 0.5) / SIZE, (y + 0.5) / SIZE
        direction = matrix[:3, :3] @ (left + (right - left) * u, top + (bottom - top) * v, ahead)
        hit, *_, thing, _ = blender.ray_cast(depsgraph, matrix[:3, 3], direction / np.linalg.norm(direction))
        if hit and thing.name in OBJECTS:
            seen[y, x] = OBJECTS.index(thing.name) + 1
    return seen


def cycles(path, size, samples):
    """Renders the scene with Cycles; returns the image, row 0 at the top."""
    blender = bpy.context.scene
    blender.render.resolution_x = blender.render.resolution_y = size
    blender.render.resolution_percentage = 100
    blender.render.engine = "CYCLES"
    settings = {"samples": samples, "use_adaptive_sampling": False, "use_denoising": False,
                "max_bounces": 24, "diffuse_bounces": 24, "glossy_bounces": 24,
                "sample_clamp_direct": 0, "sample_clamp_indirect": 0, "blur_glossy": 0,
                "light_sampling_threshold": 0, "pixel_filter_type": "BOX", "device": "CPU"}
    for key, value in settings.items():
        setattr(blender.cycles, key, value)
    for name in OBJECTS:
        bpy.data.objects[name].cycles.shadow_terminator_geometry_offset = 0
    for material in bpy.data.materials:
        for node in material.node_tree.nodes:
            if node.type == "BSDF_PRINCIPLED":
                node.distribution = "GGX"
    output = blender.render.image_settings
    output.file_format, output.color_depth = "OPEN_EXR", "32"
    blender.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return OpenEXR.File(str(path)).channels()["RGBA"].pixels[..., :3]


def taugate(program, scene, image, size, spp):
    """Renders the exported scene with taugate; returns the image, row 0 at the top."""
    command = [program, "render", scene, "--resolution", f"{size}x{size}", "--spp", str(spp), "--quiet", "-o", image]
    subprocess.run(command, check=True)
    return OpenEXR.File(str(image)).channels()["RGB"].pixels


def cells(values):
    return values.reshape(SIZE // CELL, CELL, SIZE // CELL, CELL, -1).mean(axis=(1, 3))


def ratios(ours, theirs, seen, number):
    """taugate / Cycles for all lit cells and channels. Each cell, and a border of one pixel around it, lies inside the object."""
    is_inside = np.pad(seen == number, 1)
    is_inside = np.lib.stride_tricks.sliding_window_view(is_inside, (3, 3)).all(axis=(2, 3))
    inside = cells(is_inside.astype(float))[..., 0] == 1
    ours, theirs = cells(ours)[inside], cells(theirs)[inside]
    lit = theirs > 0.02 * np.median(theirs, axis=0)
    return ours[lit] / theirs[lit]


def both(build, stem, program, size, samples):
    """Images of a scene by taugate and by Cycles. Files begin with `stem`."""
    made.reset()
    build()
    made.export(stem.with_suffix(".glb"))
    ours = taugate(program, stem.with_suffix(".glb"), stem.with_suffix(".exr"), size, samples)
    return ours, cycles(stem.with_name(stem.name + "-cycles.exr"), size, samples)


def write_picture(path, images):
    """Writes the images side by side, all with the exposure of the first one."""
    from PIL import Image
    joined = np.hstack([part for image in images for part in (image, np.ones((len(image), 4, 3)))][:-1])
    linear = np.clip(joined / np.percentile(images[0], 98), 0, 1)
    coded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    Image.fromarray((255 * coded + 0.5).astype(np.uint8)).save(path, optimize=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="render only scenes whose names begin with one of these (default: all)")
    parser.add_argument("--program", type=Path, default=ROOT / "target/release/taugate")
    parser.add_argument("--keep", type=Path, help="folder for scenes and images")
    parser.add_argument("--samples", type=int, default=512, help="samples per pixel of Cycles; taugate gets the same number")
    parser.add_argument("--picture", type=Path, help="write only the picture of docs/GUIDE.md: Cycles on the left")
    args = parser.parse_args()
    program = args.program.resolve()
    is_off = False
    lines = ["| scene | object | taugate / Cycles | middle 90 % of the cells |", "|---|---|---|---|"]
    with tempfile.TemporaryDirectory() as temporary:
        folder = (args.keep or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        if args.picture:
            write_picture(args.picture, both(made.from_blender, folder / "from-blender", program, 240, args.samples)[::-1])
            return
        for surfaces, light, is_same in SCENES:
            name = f"{surfaces.__name__.replace('_', ' ')}, {light} light"
            if args.names and not name.startswith(tuple(args.names)):
                continue
            stem = folder / f"{surfaces.__name__}-{light}"
            ours, theirs = both(lambda: made.still_life(surfaces(), light, 96), stem, program, SIZE, args.samples)
            seen = objects_seen()
            for number, thing in enumerate(OBJECTS):
                found = ratios(ours, theirs, seen, number + 1)
                low, median, high = np.percentile(found, (5, 50, 95))
                is_off |= is_same and abs(median - 1) > LIMIT
                lines.append(f"| {name} | {thing} | {median:.3f} | {low:.3f} to {high:.3f} |")
    print("\n".join(lines))
    sys.exit(int(is_off))


if __name__ == "__main__":
    main()
