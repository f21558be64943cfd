#!/usr/bin/env python3
"""Prints a Markdown table: which features of glTF the files of a corpus have, and what taugate does with them.

    python3 benches/corpus/features.py FOLDER          # after fetch.py and run.py

A feature is *read* if no message about a file names it. It is *warned about* if a warning names it, and *refused* if an error
names it. Files that are not valid glTF 2.0 are left out.
"""
import csv
import json
import sys
from collections import defaultdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import glb

MODES = {0: "points", 1: "lines", 2: "lines", 3: "lines", 5: "triangle strips", 6: "triangle fans"}
# For each feature, the words by which messages name it. Messages contain the names of extensions.
WORDS = {
    "normal textures": "normal textures", "metallic-roughness textures": "metallic-roughness textures",
    "vertex colours": "vertex colours", "skins": "skin", "morph targets": "morph", "animations": "animation",
    "a second set of texture coordinates": "texture coordinate set", "WebP images": "webp", "16-bit images": "16 bits",
}
# Features whose verdict does not follow from the messages.
FIXED = {"occlusion textures": "no effect: light transport replaces them"}
# Features that are left out; a file with nothing else is refused.
FIXED |= dict.fromkeys(("points", "lines"), "left out with a warning; refused without triangles")


def document_of(path):
    if path.read_bytes()[:4] == b"glTF":
        return glb.read(path)[0]
    return json.loads(path.read_text())


def features(document):
    """The names of all features that the file has."""
    found = set(document.get("extensionsUsed", []))
    for name in ("skins", "animations"):
        found.update([name] if document.get(name) else [])
    found.update(f"{camera.get('type')} cameras" for camera in document.get("cameras", []))
    found.update("sparse accessors" for accessor in document.get("accessors", []) if "sparse" in accessor)
    if len(document.get("scenes", [])) > 1:
        found.add("several scenes")
    for image in document.get("images", []) + document.get("buffers", []):
        if "uri" in image:
            found.add("data URIs" if image["uri"].startswith("data:") else "files beside the .gltf file")
    for image in document.get("images", []):
        kind = image.get("mimeType", "") + image.get("uri", "")[:30].lower()
        found.update(name for words, name in (("png", "PNG images"), ("jpeg", "JPEG images"), ("jpg", "JPEG images"),
                                              ("webp", "WebP images"), ("ktx2", "KTX2 images")) if words in kind)
    for node in document.get("nodes", []):
        scale = node.get("scale", [1, 1, 1])
        found.update(["mirrored nodes"] if scale[0] * scale[1] * scale[2] < 0 else [])
    for material in document.get("materials", []):
        pbr = material.get("pbrMetallicRoughness", {})
        slots = {"base colour textures": pbr.get("baseColorTexture"),
                 "metallic-roughness textures": pbr.get("metallicRoughnessTexture"),
                 "normal textures": material.get("normalTexture"), "occlusion textures": material.get("occlusionTexture"),
                 "emission textures": material.get("emissiveTexture")}
        found.update(name for name, texture in slots.items() if texture)
        if any(texture and texture.get("texCoord") for texture in slots.values()):
            found.add("a second set of texture coordinates")
        if material.get("alphaMode", "OPAQUE") != "OPAQUE":
            found.add(f"alpha mode {material['alphaMode']}")
        found.update(["double-sided materials"] if material.get("doubleSided") else [])
    for mesh in document.get("meshes", []):
        for primitive in mesh["primitives"]:
            attributes = primitive.get("attributes", {})
            found.update(["vertex colours"] if "COLOR_0" in attributes else [])
            found.update(["meshes without normals"] if "NORMAL" not in attributes else [])
            found.update(["meshes without indices"] if "indices" not in primitive else [])
            found.update(["morph targets"] if primitive.get("targets") else [])
            found.update([MODES[primitive["mode"]]] if primitive.get("mode") in MODES else [])
    return found


def verdict(name, messages):
    """What taugate does with the feature. `messages`: the result and the message of each file that has it."""
    if name in FIXED:
        return FIXED[name]
    words = WORDS.get(name, name).lower()
    naming = {result for result, message in messages if words in message.lower()}
    if "warned" in naming:
        return "warned about"
    if "refused" in naming:
        return "refused"
    if all(result == "refused" for result, _ in messages):
        return "unknown: its files are refused for other reasons"
    return "read"


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    root = Path(sys.argv[1])
    files = root / "files" if (root / "files").is_dir() else root
    messages = defaultdict(list)
    count = 0
    with open(root / "results/results.csv", newline="") as table:
        for row in csv.DictReader(table):
            try:
                document = document_of(files / row["file"])
                if not document["asset"]["version"].startswith("2"):
                    continue
                found = features(document)
            except (ValueError, KeyError, TypeError, AttributeError, IndexError):
                continue
            count += 1
            for name in found:
                messages[name].append((row["result"], row["message"]))
    groups = defaultdict(list)
    for name, of in sorted(messages.items(), key=lambda item: (-len(item[1]), item[0])):
        shown = f"`{name}`" if name.startswith(("KHR_", "EXT_", "VRM", "MSFT_", "AGI_", "FB_", "CESIUM_")) else name
        groups[verdict(name, of)].append(f"{shown} {len(of)}")
    print(f"| taugate | feature, and how many of {count} files have it |\n|---|---|")
    for name, list_of in sorted(groups.items(), key=lambda item: -len(item[1])):
        print(f"| {name} | {', '.join(list_of)} |")


if __name__ == "__main__":
    main()
