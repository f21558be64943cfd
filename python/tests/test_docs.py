"""Every snippet of docs/PYTHON.md runs."""

import inspect
import re
import warnings

import pytest

import taugate
from conftest import ROOT

SNIPPETS = re.findall(r"^```python([^\n]*)\n(.*?)^```", (ROOT / "docs/PYTHON.md").read_text(encoding="utf-8"), re.M | re.S)


def run(snippets, names):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for text in snippets:
            exec(compile(text, "docs/PYTHON.md", "exec"), names)


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
