#!/usr/bin/env python3
"""Collects the licence texts of all crates that a wheel contains into LICENSE-CRATES.txt, which the next wheel then includes.

    python3 python/licences.py
    pip wheel -v --no-deps --wheel-dir wheels ./python

Needs cargo. A crate without a text of its own is listed with its licence expression and its repository.
"""

import collections
import json
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
OUTPUT = HERE / "LICENSE-CRATES.txt"
WITHOUT_TEXT = "These crates contain no text of their licence. LICENSE-APACHE and LICENSE-MIT have the texts in general."
PREFIXES = ("license", "licence", "copying", "copyright", "notice", "unlicense")


def main():
    packages = crates()
    owners = collections.defaultdict(list)
    for package in packages:
        for text in texts(package) or [""]:
            owners[text].append(package)
    parts = ["Licences of the crates in this wheel of taugate, which itself is under MIT or Apache 2.0.\n"]
    parts += [f"{label(package)}: {package['license'] or 'see its text'}" for package in packages]
    for text, of in sorted(owners.items(), key=lambda item: (not item[0], label(item[1][0]))):
        names = "\n".join(label(package) if text else f"{label(package)}: {package['license']}, {package['repository']}" for package in of)
        parts.append(f"\n{'=' * 80}\n{names}\n{'-' * 80}\n{text or WITHOUT_TEXT}")
    OUTPUT.write_text("\n".join(parts) + "\n", encoding="utf-8")
    print(f"{OUTPUT}: {len(packages)} crates", file=sys.stderr)


def crates():
    """The crates that are linked into the module on this machine, without those of this repository, in order of their names."""
    host = next(line.split()[1] for line in run("rustc", "-vV").splitlines() if line.startswith("host"))
    found = json.loads(run("cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", host))
    packages = {package["id"]: package for package in found["packages"]}
    edges = {node["id"]: node["deps"] for node in found["resolve"]["nodes"]}
    waiting, reached = [found["resolve"]["root"]], set()
    while waiting:
        one = waiting.pop()
        if one not in reached:
            reached.add(one)
            # Those for tests and build scripts have another kind.
            waiting += [edge["pkg"] for edge in edges[one] if any(kind["kind"] is None for kind in edge["dep_kinds"])]
    return sorted((packages[one] for one in reached if packages[one]["source"]), key=label)


def texts(package):
    """The licence texts of a crate."""
    folder = pathlib.Path(package["manifest_path"]).parent
    named = (file for file in folder.rglob("*") if file.is_file() and file.name.lower().startswith(PREFIXES))
    files = sorted(file for file in named if file.suffix.lower() not in (".rs", ".json"))
    return [file.read_text(encoding="utf-8", errors="replace").strip() for file in files]


def label(package):
    return f"{package['name']} {package['version']}"


def run(*words):
    return subprocess.run(words, cwd=HERE, check=True, stdout=subprocess.PIPE, text=True).stdout


if __name__ == "__main__":
    main()
