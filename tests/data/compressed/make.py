#!/usr/bin/env python3
"""Writes torus.glb and its compressed versions into the folder of this script.

npm install gltfpack@1.3 @gltf-transform/cli@4.5.1, then: tests/data/compressed/make.py NODE_MODULES
"""

import json, math, struct, subprocess, sys, zlib
from pathlib import Path

AROUND, ACROSS = 16, 8
HERE = Path(__file__).parent


def png(pixels):
    rows = b"".join(b"\0" + bytes(sum(row, [])) for row in pixels)
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    header = struct.pack(">IIBBBBB", len(pixels[0]), len(pixels), 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def torus():
    positions, normals, uvs, indices = [], [], [], []
    for i in range(AROUND + 1):
        for j in range(ACROSS + 1):
            u, v = 2 * math.pi * i / AROUND, 2 * math.pi * j / ACROSS
            ring = 1 + 0.4 * math.cos(v)
            positions.append((ring * math.cos(u), 0.4 * math.sin(v), ring * math.sin(u)))
            normals.append((math.cos(v) * math.cos(u), math.sin(v), math.cos(v) * math.sin(u)))
            uvs.append((2 * i / AROUND, j / ACROSS))
    for i in range(AROUND):
        for j in range(ACROSS):
            a = i * (ACROSS + 1) + j
            b = a + ACROSS + 1
            indices += [a, a + 1, b, b, a + 1, b + 1]
    return positions, normals, uvs, indices


def main():
    positions, normals, uvs, indices = torus()
    floats = lambda vectors: b"".join(struct.pack(f"<{len(v)}f", *v) for v in vectors)
    image = png([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]])
    views = [floats(positions), floats(normals), floats(uvs), struct.pack(f"<{len(indices)}H", *indices), image]
    bin, buffer_views = b"", []
    for view in views:
        buffer_views.append({"buffer": 0, "byteOffset": len(bin), "byteLength": len(view)})
        bin += view + b"\0" * (-len(view) % 4)
    accessor = lambda view, kind, component, count, **more: {
        "bufferView": view, "type": kind, "componentType": component, "count": count, **more}
    limits = {"min": [min(p[k] for p in positions) for k in range(3)], "max": [max(p[k] for p in positions) for k in range(3)]}
    half = math.sqrt(0.5)
    scene = {
        "asset": {"version": "2.0", "generator": "make.py"},
        "buffers": [{"byteLength": len(bin)}],
        "bufferViews": buffer_views,
        "accessors": [
            accessor(0, "VEC3", 5126, len(positions), **limits),
            accessor(1, "VEC3", 5126, len(normals)),
            accessor(2, "VEC2", 5126, len(uvs)),
            accessor(3, "SCALAR", 5123, len(indices)),
        ],
        "images": [{"bufferView": 4, "mimeType": "image/png"}],
        "textures": [{"source": 0}],
        "materials": [{"name": "paint", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0}}],
        "meshes": [{"name": "torus", "primitives": [
            {"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}, "indices": 3, "material": 0}]}],
        "nodes": [
            {"mesh": 0, "translation": [0, 0, -3]},
            {"mesh": 0, "translation": [3, 1, -3], "rotation": [half, 0, 0, half], "scale": [0.5, 0.5, 0.5]},
        ],
        "scenes": [{"nodes": [0, 1]}],
        "scene": 0,
    }
    text = json.dumps(scene, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(bin)
    source = HERE / "torus.glb"
    source.write_bytes(
        b"glTF" + struct.pack("<II", 2, size) + struct.pack("<I", len(text)) + b"JSON" + text
        + struct.pack("<I", len(bin)) + b"BIN\0" + bin)

    tools = Path(sys.argv[1]) / ".bin"
    run = lambda tool, *arguments: subprocess.run([tools / tool, *map(str, arguments)], check=True)
    pack = lambda name, *flags: run("gltfpack", "-i", source, "-o", HERE / f"{name}.glb", *flags)
    pack("quantized")
    pack("quantized-normalized", "-vpn", "-vn", "16", "-vi")
    pack("meshopt-ext", "-c", "-ce", "ext")
    pack("meshopt-khr", "-cc", "-ce", "khr", "-mi")
    pack("meshopt-floats", "-c", "-vpf", "-vnf", "-vtf", "-ce", "ext")
    pack("meshopt-fallback", "-cf", "-ce", "ext", "-mi")
    run("gltf-transform", "draco", source, HERE / "draco-edgebreaker.glb")
    run("gltf-transform", "draco", source, HERE / "draco-sequential.glb", "--method", "sequential")


main()
