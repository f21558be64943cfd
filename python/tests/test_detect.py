"""Photon counts: the same bits as the program."""

import numpy as np
import pytest

import taugate
from conftest import SCENES

SETTINGS = {"resolution": (8, 6), "spp": 4, "max_depth": 4}


def test_counts_of_a_histogram_have_the_bits_of_the_program(program, tmp_path):
    light = taugate.histogram(SCENES / "cornell-box.glb", gates=(4, 10, 12), **SETTINGS)
    light.save(tmp_path / "light.npy")
    flags = ["--photons", "1e4", "--pulses", "50", "--first-photon", "--jitter", "100ps", "--background", "2"]
    code, text = program("detect", "light.npy", "-o", "counts.npy", *flags)
    assert code == 0, text
    counts = taugate.detect(light, 1e4, pulses=50, first_photon=True, jitter="100ps", background=2.0)
    assert counts.data.sum() > 0 and np.array_equal(np.load(tmp_path / "counts.npy"), counts.data)
    assert not np.array_equal(counts.data, taugate.detect(light, 1e4, pulses=50, background=2.0, seed=1).data)
    counts.save(tmp_path / "again.npy")
    code, text = program("histogram", "again.npy")
    assert code == 0, text


def test_counts_of_an_image_have_a_background_per_pixel(program, tmp_path):
    scene = taugate.load(SCENES / "cornell-box.glb", **SETTINGS)
    light, daylight = taugate.render(scene, gate="6m..7m"), taugate.render(scene)
    light.save(tmp_path / "light.exr")
    daylight.save(tmp_path / "daylight.exr")
    flags = ["--photons", "1e3", "--mono", "--background", "daylight.exr", "--png"]
    code, text = program("detect", "light.exr", "-o", "counts.npy", *flags)
    assert code == 0, text
    assert (tmp_path / "counts.png").read_bytes().startswith(b"\x89PNG")
    counts = taugate.detect(light, 1e3, mono=True, background=daylight)
    assert counts.data.shape == (6, 8, 1) and np.array_equal(np.load(tmp_path / "counts.npy"), counts.data)


@pytest.mark.parametrize(
    "settings, part",
    [
        ({"photons": -1}, "--photons is -1"),
        ({"photons": 1, "efficiency": 2}, "from 0 to 1"),
        ({"photons": 1, "dead_time": 1.0, "first_photon": True}, "keep one"),
        ({"photons": 1, "jitter": "5"}, "like 100m or 400ns"),
        ({"photons": 1, "background": np.ones((2, 2, 3))}, "must be a number or have the shape"),
    ],
)
def test_wrong_arguments_have_the_message_of_the_program(settings, part):
    light = taugate.histogram(SCENES / "cornell-box.glb", gates=(4, 10, 3), **SETTINGS)
    with pytest.raises(taugate.SettingsError, match=part):
        taugate.detect(light, **settings)


def test_counts_are_no_light_and_daylight_has_the_crop_of_the_light():
    light = taugate.render(SCENES / "cornell-box.glb", gate="6m..7m", crop=(0, 4, 0, 6), **SETTINGS)
    daylight = taugate.render(SCENES / "cornell-box.glb", crop=(4, 8, 0, 6), **SETTINGS)
    with pytest.raises(taugate.SettingsError, match="another part of the image"):
        taugate.detect(light, 1e3, background=daylight)


def test_scans_are_counted():
    data = np.arange(6, dtype=np.float32).reshape(3, 2)
    gate = {"name": "g", "gate_begin_m": 0, "gate_end_m": 1, "weight_integral_m": 1}
    gates = [{**gate, "gate_begin_m": k, "gate_end_m": k + 1} for k in range(3)]
    scan = taugate.Scan(data, {"axes": "response, point", "responses": gates, "laser_points": [[0, 0, 0]] * 2})
    counts = taugate.detect(scan, 1e6)
    assert counts.data.shape == (3, 2) and np.allclose(counts.data, 1e6 * data, rtol=0.01)
    with pytest.raises(taugate.SettingsError, match="counts of a detector, not light"):
        taugate.detect(taugate.Scan(counts.data, counts.description), 1.0)
