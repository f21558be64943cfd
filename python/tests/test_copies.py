"""Results and scenes that go to other processes."""

import copy
import gc
import os
import pickle

import numpy as np
import pytest

import taugate
from taugate import _words

from conftest import SIZE, room

GRID = np.linspace(0, 2, 2 * 3 * 4, dtype=np.float32).reshape(2, 3, 4)
FOG = dict(sigma_s=0.1, medium_bounds=(-2, 0, -2, 2, 2, 2), light_paths=500, spp=4)


def test_images_are_pickled_and_copied(box, tmp_path):
    image = taugate.render(box, gate="5m..6m", spp=4, light_paths=500, aov="depth,object")
    for twin in (pickle.loads(pickle.dumps(image)), copy.deepcopy(image), copy.copy(image)):
        assert (twin.pixels == image.pixels).all() and (twin.variance == image.variance).all() and twin.pixels.any()
        assert (twin.depth == image.depth).all() and (twin.object == image.object).all()
        assert twin.objects == image.objects and twin.gate == image.gate and twin.settings == image.settings
        assert (twin.camera.K == image.camera.K).all() and twin.mean == image.mean and repr(twin) == repr(image)
        for name, one in (("a", image), ("b", twin)):
            one.save(tmp_path / f"{name}.exr")
            one.save(tmp_path / f"{name}.npy")
        assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
        # The order of the attributes of an .exr file is random.
        assert sorted((tmp_path / "a.exr").read_bytes()) == sorted((tmp_path / "b.exr").read_bytes())
    twin = copy.deepcopy(image)
    twin.pixels[0] += 1
    assert (twin.pixels[0] != image.pixels[0]).all(), "the arrays are copies"
    with pytest.raises(taugate.SettingsError, match="no sums"):
        taugate._native.NativeImage.restored(b"nothing", {}, "")
    with pytest.raises(taugate.SettingsError, match=r"only images of taugate.farm can be saved as sums"):
        image.save(tmp_path / "a.acc")


def test_histograms_are_pickled_without_their_files(box, tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("tau_m,weight\n5,0\n5.5,1\n6,0\n")
    for settings in (dict(gates=(5, 7, 4), variance=True), dict(cw="20"), dict(response=f"a={table}")):
        histogram = taugate.histogram(box, spp=2, light_paths=500, resolution=(8, 6), **settings)
        data = pickle.dumps(histogram)
        table.unlink(missing_ok=True)
        twin = pickle.loads(data)
        assert (twin.pixels == histogram.pixels).all() and (twin.gates == histogram.gates).all() and twin.pixels.any()
        assert twin.names == histogram.names and twin.layers.keys() == histogram.layers.keys()
        assert (twin.variance is None) == (histogram.variance is None)
        table.write_text("tau_m,weight\n5,0\n5.5,1\n6,0\n")


def test_density_grids_are_arrays(tmp_path):
    np.save(tmp_path / "grid.npy", GRID)
    from_file = taugate.render(room(), density_grid=tmp_path / "grid.npy", **FOG)
    scene = room(density_grid=GRID, sigma_s=0.1)
    given = [
        taugate.render(room(), density_grid=GRID, **FOG),
        taugate.render(room(), density_grid=np.asfortranarray(GRID.astype(float)), **FOG),
        taugate.render(scene, **FOG),
        taugate.render(pickle.loads(pickle.dumps(scene)), **FOG),
    ]
    for image in given:
        assert (image.pixels == from_file.pixels).all()
    assert (taugate.render(room(), density_grid=GRID[::-1], **FOG).pixels != from_file.pixels).any()
    for wrong in (GRID[0], GRID.astype(complex)):
        with pytest.raises(taugate.SettingsError, match="must be numbers \\(Z, Y, X\\)"):
            taugate.render(scene, density_grid=wrong)
    with pytest.raises(taugate.SettingsError, match="density"):
        taugate.render(scene, density_grid=-GRID, **FOG)


def test_temporary_files_of_grids_are_deleted():
    words = _words.words(dict(density_grid=GRID + 1), "test")
    [(_, [path])] = words
    assert os.path.exists(path) and _words.words(dict(density_grid=GRID + 1), "test")[0][1] == [path]
    del words
    gc.collect()
    assert not os.path.exists(path)
