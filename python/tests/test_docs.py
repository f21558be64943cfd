"""Every snippet of docs/PYTHON.md runs."""

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
