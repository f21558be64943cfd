"""The snippets of docs/PYTHON.md and docs/GUIDE.md run."""

import inspect
import re
import shutil
import warnings

import numpy as np
import pytest

import taugate
from conftest import ROOT


def snippets_of(document):
    """The snippets of a document with the words after `python`."""
    return re.findall(r"^```python([^\n]*)\n(.*?)^```", (ROOT / document).read_text(encoding="utf-8"), re.M | re.S)


SNIPPETS = snippets_of("docs/PYTHON.md")


def run(snippets, names, document="docs/PYTHON.md"):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for text in snippets:
            exec(compile(text, document, "exec"), names)


def test_snippets_run_one_after_the_other(tmp_path, monkeypatch):
    matplotlib = pytest.importorskip("matplotlib")
    pytest.importorskip("h5py")
    matplotlib.use("Agg")
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    monkeypatch.chdir(tmp_path)
    names = {}
    run([text for label, text in SNIPPETS if not label], names)
    assert names["histogram"].pixels.shape == (64, 64, 60, 3) and names["image"].pixels.any()
    assert len(names["frames"]) == 3 and (tmp_path / "scan.hdf5").exists()
    assert len(SNIPPETS) >= 8


def test_snippets_of_the_guide_run(program, tmp_path, monkeypatch):
    # The files that the commands of the guide make, with fewer pixels and samples.
    render = ("render", ROOT / "scenes/cornell-box.glb", "--resolution", "32x32", "--spp", 2)
    for words in (("--gates", "5m..8m/3", "-o", "histogram.npy", "-o", "box.acc"), ("--aov", "depth,object", "-o", "layers.exr")):
        code, text = program(*render, *words)
        assert code == 0, text
    shutil.copy(tmp_path / "layers.exr", tmp_path / "out.exr")
    monkeypatch.chdir(tmp_path)
    snippets = [text for _, text in snippets_of("docs/GUIDE.md")]
    names = {}
    # Blender runs the first one.
    run([text for text in snippets if not re.search("bpy|OpenEXR", text)], names, "docs/GUIDE.md")
    assert np.load("ball.npy").shape == (64, 64, 64) and names["histogram"].shape == (3, 3)
    image = np.load("histogram.npy")[:, :, 0]
    assert np.allclose(names["image"], image, rtol=1e-6) and image.any() and len(snippets) == 6
    pytest.importorskip("OpenEXR")
    run([text for text in snippets if "OpenEXR" in text], names, "docs/GUIDE.md")
    assert names["image"].shape == names["variance"].shape == (32, 32, 3) and names["image"].any()
    assert names["names"][str(names["ids"][16, 16])] and names["depth"][16, 16] > 3


def test_every_public_name_is_documented():
    for name in taugate.__all__:
        assert getattr(taugate, name).__doc__, name


def public_functions():
    """The public functions, and the methods and properties of the public classes."""
    from taugate import farm

    things = [farm.render, farm.dataset, *(getattr(taugate, name) for name in taugate.__all__)]
    yield from filter(inspect.isfunction, things)
    classes = {base for thing in things if inspect.isclass(thing) for base in thing.__mro__ if base.__module__.startswith("taugate")}
    for name, member in (item for one in classes for item in vars(one).items()):
        if name == "__init__" or not name.startswith("_"):
            yield from filter(inspect.isfunction, (getattr(member, kind, None) for kind in ("fget", "func", "__func__")))
            yield from filter(inspect.isfunction, [member])


def test_every_public_function_has_types():
    found = {function.__qualname__: inspect.signature(function) for function in public_functions()}
    assert {"render", "Camera.look_at", "Camera.K", "Camera.__init__", "_Result.samples", "Image.pixels", "Scene.add_mesh"} <= set(found)
    for name, signature in found.items():
        parameters = [one for key, one in signature.parameters.items() if key not in ("self", "cls")]
        assert inspect.Signature.empty not in [signature.return_annotation, *(one.annotation for one in parameters)], name
