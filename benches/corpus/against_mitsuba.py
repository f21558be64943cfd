#!/usr/bin/env python3
"""Compares taugate with Mitsuba on glTF files of other programs, which the library trimesh reads for Mitsuba.

    pip install mitsuba trimesh pillow numpy OpenEXR           # and a recent LLVM (Debian: libllvm19)
    cargo build --release
    python3 benches/corpus/fetch.py FOLDER
    python3 benches/corpus/against_mitsuba.py FOLDER [--program target/release/taugate] [--keep FOLDER]

The two programs share no code on the way from the file to the image. So the comparison covers transforms, normals, texture
coordinates, textures and light transport. Mitsuba has no glTF materials, so each file is rendered with one material that both
programs have:

    diffuse    0.8 times the base colour texture
    metal      white metal, roughness 0.5 (GGX alpha 0.25); Fresnel reflectance 1 at all angles
    plastic    base colour 0.8 under a dielectric coat of roughness 0.5; Mitsuba: `principled`, a different model

A camera and a point light are added. The table gives taugate / Mitsuba: the median over cells of 4 x 4 pixels, and the range
that holds the middle 90 % of the cells. Cells with an unlit pixel, for example at silhouettes, are left out. Exits with 1 if a
median is off by more than 3 % although both programs have the same material model. Without Mitsuba it prints a message and exits with 0.
"""
import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "benches")]
import mitsuba_or_skip
mi, np, trimesh, OpenEXR = mitsuba_or_skip.modules("numpy", "trimesh", "OpenEXR")
import glb

SIZE, CELL, LIMIT, FOV = 128, 4, 0.03, 0.7
ALBEDO, ROUGHNESS, MAX_DEPTH = 0.8, 0.5, 24
WEBXR = "webxr-input-profiles-assets/package/dist/profiles"
# File below FOLDER/files, material, direction of the camera from the middle of the model.
CASES = [
    ("gradio/gradio/media_assets/models3d/Duck.glb", "diffuse", (0.5, 0.4, 1.0)),
    (f"{WEBXR}/oculus-touch-v3/left.glb", "diffuse", (0.5, 0.8, 1.0)),
    ("mani-skill/mani_skill/utils/scene_builder/kitchen_counter/assets/kitchen_counter.glb", "diffuse", (0.6, 0.6, 1.0)),
    ("assimp-testmodels/usr/share/assimp/models/glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb", "diffuse", (0.5, 0.6, 1.0)),
    ("assimp-testmodels/usr/share/assimp/models/glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb", "metal", (0.5, 0.6, 1.0)),
    ("blender/hierarchy.glb", "metal", (0.3, 0.8, 1.0)),
    ("blender/plastics.glb", "plastic", (0.0, 0.5, 1.0)),
]


def read_meshes(path):
    """The meshes of a file in world space, as trimesh reads them, with the normals of the file."""
    scene = trimesh.load_scene(path, process=False)
    meshes = []
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        if not isinstance(scene.geometry[name], trimesh.Trimesh):
            continue
        mesh = scene.geometry[name].copy()
        normals = scene.geometry[name].vertex_normals @ np.linalg.inv(matrix[:3, :3])
        mesh.apply_transform(matrix)
        meshes.append((mesh, normals / np.linalg.norm(normals, axis=1, keepdims=True)))
    return meshes


def view(meshes, direction):
    """The camera-to-world matrix, the position of the light (above and to the right of the camera), and the camera's distance."""
    corners = np.array([mesh.bounds for mesh, _ in meshes])
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    middle, radius = (low + high) / 2, np.linalg.norm(high - low) / 2
    back = np.array(direction) / np.linalg.norm(direction)
    distance = radius / np.sin(FOV / 2) * 0.8
    right = np.cross((0, 1, 0), back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([right, np.cross(back, right), back])
    matrix[:3, 3] = middle + distance * back
    return matrix, matrix[:3, 3] + matrix[:3, :3] @ (0.3 * distance, 0.4 * distance, 0.0), distance


def rewritten(path, target, kind, matrix, light, intensity):
    """Writes the file with the material, a camera and a light to `target`; all else is as in the file."""
    document, binary = glb.read(path)
    for material in document.setdefault("materials", []):
        old = material.get("pbrMetallicRoughness", {})
        name = material.get("name", "")
        white = {"diffuse": ALBEDO, "metal": 1.0, "plastic": ALBEDO}[kind]
        surface = {"baseColorFactor": [white, white, white, 1.0], "metallicFactor": float(kind == "metal"),
                   "roughnessFactor": ROUGHNESS}
        if kind == "diffuse" and "baseColorTexture" in old:
            surface["baseColorTexture"] = old["baseColorTexture"]
        material.clear()
        material.update(name=name, doubleSided=True, pbrMetallicRoughness=surface)
        if kind == "diffuse":
            material["extensions"] = {"KHR_materials_specular": {"specularFactor": 0.0}}
    document["extensionsUsed"] = ["KHR_materials_specular", "KHR_lights_punctual"]
    document.pop("extensionsRequired", None)
    document["cameras"] = [{"type": "perspective", "perspective": {"yfov": FOV, "aspectRatio": 1.0, "znear": 0.01}}]
    document["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": float(intensity)}]}}
    for node in document["nodes"]:
        node.pop("camera", None)
        node.pop("extensions", None)
    document["nodes"] += [
        {"name": "camera", "camera": 0, "matrix": matrix.T.ravel().tolist()},
        {"name": "light", "translation": light.tolist(), "extensions": {"KHR_lights_punctual": {"light": 0}}},
    ]
    count = len(document["nodes"])
    document["scenes"][document.get("scene", 0)]["nodes"] += [count - 2, count - 1]
    glb.write(target, document, binary)


def reflectance(mesh):
    """0.8 times the mesh's base colour texture, decoded from sRGB, as a Mitsuba texture."""
    image = getattr(getattr(mesh.visual, "material", None), "baseColorTexture", None)
    if image is None:
        return {"type": "rgb", "value": ALBEDO}
    coded = np.asarray(image.convert("RGB"), dtype=np.float32) / 255
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    return {"type": "bitmap", "bitmap": mi.Bitmap((ALBEDO * linear).astype(np.float32)), "raw": True}


def bsdf(mesh, kind):
    if kind == "diffuse":
        inside = {"type": "diffuse", "reflectance": reflectance(mesh)}
    elif kind == "metal":
        inside = {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": ROUGHNESS**2}
    else:
        inside = {"type": "principled", "base_color": {"type": "rgb", "value": ALBEDO}, "roughness": ROUGHNESS, "eta": 1.5}
    return mi.load_dict({"type": "twosided", "bsdf": inside})


def mitsuba_mesh(name, mesh, normals, kind):
    properties = mi.Properties()
    properties["bsdf"] = bsdf(mesh, kind)
    uvs = getattr(mesh.visual, "uv", None) if kind == "diffuse" else None
    made = mi.Mesh(name, len(mesh.vertices), len(mesh.faces), has_vertex_normals=True, has_vertex_texcoords=uvs is not None,
                   props=properties)
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = mesh.vertices.astype(np.float32).ravel()
    parameters["vertex_normals"] = normals.astype(np.float32).ravel()
    parameters["faces"] = mesh.faces.astype(np.uint32).ravel()
    if uvs is not None:
        # trimesh turns v upside down; Mitsuba and glTF agree that v points down.
        parameters["vertex_texcoords"] = np.column_stack([uvs[:, 0], 1 - uvs[:, 1]]).astype(np.float32).ravel()
    parameters.update()
    return made


def mitsuba(meshes, kind, matrix, light, intensity, samples):
    to_world = mi.ScalarTransform4f().look_at(origin=matrix[:3, 3].tolist(), target=(matrix[:3, 3] - matrix[:3, 2]).tolist(),
                                              up=matrix[:3, 1].tolist())
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}}
    scene = {"type": "scene", "integrator": {"type": "path", "max_depth": MAX_DEPTH, "rr_depth": 100},
             "sensor": {"type": "perspective", "fov": float(np.degrees(FOV)), "fov_axis": "y", "near_clip": 1e-4,
                        "to_world": to_world, "film": film},
             "light": {"type": "point", "position": light.tolist(), "intensity": {"type": "rgb", "value": float(intensity)}}}
    for number, (mesh, normals) in enumerate(meshes):
        scene[f"mesh_{number}"] = mitsuba_mesh(f"mesh_{number}", mesh, normals, kind)
    return np.array(mi.render(mi.load_dict(scene), spp=samples))[..., :3]


def ratios(ours, theirs):
    """taugate / Mitsuba for all channels of the cells in which every pixel is lit."""
    def cells(image):
        return image.reshape(SIZE // CELL, CELL, SIZE // CELL, CELL, 3)

    ours, theirs = cells(ours), cells(theirs)
    is_lit = ((ours.sum(axis=4) > 0) & (theirs.sum(axis=4) > 0)).all(axis=(1, 3))
    ours, theirs = ours.mean(axis=(1, 3))[is_lit], theirs.mean(axis=(1, 3))[is_lit]
    bright = theirs > 0.02 * np.median(theirs)
    return ours[bright] / theirs[bright]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="the folder that fetch.py filled")
    parser.add_argument("--program", type=Path, default=ROOT / "target/release/taugate")
    parser.add_argument("--keep", type=Path, help="folder for scenes and images")
    parser.add_argument("--samples", type=int, default=256, help="samples per pixel of both programs")
    args = parser.parse_args()
    is_off = False
    print("| file | material | taugate / Mitsuba | middle 90 % of the cells |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as temporary:
        folder = (args.keep or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        for name, kind, direction in CASES:
            path = args.folder / "files" / name
            if not path.exists():
                print(f"left out: {name}; fetch.py did not find its package", file=sys.stderr)
                continue
            meshes = read_meshes(path)
            matrix, light, distance = view(meshes, direction)
            stem = folder / f"{Path(name).parent.name}-{Path(name).stem}-{kind}"
            rewritten(path, stem.with_suffix(".glb"), kind, matrix, light, 10 * distance**2)
            image = stem.with_suffix(".exr")
            subprocess.run([args.program.resolve(), "render", stem.with_suffix(".glb"), "--camera", "camera", "--resolution",
                            f"{SIZE}x{SIZE}", "--spp", str(args.samples), "--max-depth", str(MAX_DEPTH), "--quiet", "-o", image],
                           check=True)
            theirs = mitsuba(meshes, kind, matrix, light, 10 * distance**2, args.samples)
            mi.Bitmap(theirs.astype(np.float32)).write(str(stem) + "-mitsuba.exr")
            found = ratios(OpenEXR.File(str(image)).channels()["RGB"].pixels, theirs)
            low, median, high = np.percentile(found, (5, 50, 95))
            is_off |= kind != "plastic" and abs(median - 1) > LIMIT
            print(f"| {Path(name).parent.name}/{Path(name).name} | {kind} | {median:.3f} | {low:.3f} to {high:.3f} |")
    sys.exit(int(is_off))


if __name__ == "__main__":
    main()
