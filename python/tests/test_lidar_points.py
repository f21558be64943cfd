"""examples/lidar_points.py finds the surfaces of histograms that are made here, with the noise of a render of 64 samples per beam."""

import importlib.util
import json
import subprocess
import sys

import numpy as np
import pytest

from places import ROOT

EXAMPLE = ROOT / "examples" / "lidar_points.py"
# Gates of 0.1 m in depth, from 2 m on.
START, WIDTH, GATES = 2.0, 0.1, 600
BEAMS, SAMPLES = 100, 64

spec = importlib.util.spec_from_file_location("lidar_points", EXAMPLE)
lidar_points = importlib.util.module_from_spec(spec)
spec.loader.exec_module(lidar_points)


def surface(near, far, samples, random):
    """Light of surfaces at these depths in m: `samples` equally bright samples at stratified depths."""
    depths = near + (far - near) * (np.arange(samples) + random.random((BEAMS, samples))) / max(samples, 1)
    gates = ((depths - START) / WIDTH).astype(int)
    return np.stack([np.bincount(beam, minlength=GATES) / SAMPLES for beam in gates], axis=1)


def fog(sigma, random):
    """Light that fog scatters straight back. Every gate has its own random error, larger near the laser."""
    r = START + WIDTH * (np.arange(GATES) + 0.5)
    mean = 2.0 * np.exp(-2 * sigma * r) / r**2
    return mean[:, None] * random.gamma(4, 1 / 4, (GATES, BEAMS))


def found(light, keep, variance=None):
    noise = lidar_points.noise_of(light, SAMPLES, variance)
    beams = [lidar_points.echoes(seen, errors, 0.5 / WIDTH, 3) for seen, errors in zip(light.T, noise.T)]
    return [[START + WIDTH * (echo[0] + 0.5) for echo in lidar_points.KEEP[keep](beam)] if beam else [] for beam in beams]


def share(beams, depths, within=0.15):
    """The share of the beams that have exactly these depths."""
    return np.mean([len(b) == len(depths) and np.allclose(b, depths, atol=within) for b in beams])


def test_a_surface_in_fog_is_found_behind_the_light_of_the_fog():
    random = np.random.default_rng(1)
    light = fog(0.02, random) + 0.3 * surface(30.0, 30.05, SAMPLES, random)
    for keep in ["all", "strongest", "last"]:
        assert share(found(light, keep), [30.0]) > 0.95, keep
    # The rule before: the two earliest of all peaks above 1 % of the highest. None is the surface.
    around = np.pad(light, ((1, 1), (0, 0)))
    peaks = (light > around[:-2]) & (light >= around[2:]) & (light > 0.01 * light.max(axis=0))
    earliest = [START + WIDTH * (np.flatnonzero(beam)[:2] + 0.5) for beam in peaks.T]
    assert not any(np.any(np.abs(depths - 30.0) < 0.15) for depths in earliest)


def test_a_slanted_wall_is_one_echo():
    random = np.random.default_rng(2)
    # The floor far away: the light of a beam arrives over 1 m and over 6 m.
    for near, far in [(20.0, 21.0), (40.0, 46.0)]:
        light = surface(near, far, SAMPLES, random)
        assert share(found(light, "all"), [0.5 * (near + far)]) == 1.0
        assert share(found(light, "all", variance=0 * light), [0.5 * (near + far)]) == 1.0


def test_two_surfaces_are_two_echoes_unless_they_are_nearer_than_the_distance():
    random = np.random.default_rng(3)
    light = surface(20.0, 20.04, 24, random) + surface(25.0, 25.04, 40, random)
    beams = found(light, "all")
    assert share(beams, [20.05, 25.05], 0.06) == 1.0
    assert share(found(light, "strongest"), [25.05], 0.06) == 1.0
    assert share(found(light, "last"), [25.05], 0.06) == 1.0
    assert share(found(light, "first-and-last"), [20.05, 25.05], 0.06) == 1.0
    near = surface(20.0, 20.04, 24, random) + surface(20.3, 20.34, 40, random)
    assert all(len(beam) == 1 for beam in found(near, "all"))


def test_a_beam_without_light_has_no_point(tmp_path):
    light = np.zeros((GATES, 2), np.float32)
    light[100, 0] = 1.0
    np.save(tmp_path / "scan.npy", light)
    about = {"laser": [0, 1, 0], "laser_points": [[0, 1, -1], [1, 1, 0]], "samples": SAMPLES, "account_first_and_last_bounces": True}
    about |= {"start_opl": 2 * START, "bin_width_opl": 2 * WIDTH}
    (tmp_path / "scan.json").write_text(json.dumps(about))
    for arguments in [[], ["--keep", "last"]]:
        words = [sys.executable, EXAMPLE, tmp_path / "scan.npy", tmp_path / "points.ply", *arguments]
        assert "1 points of 2 beams" in subprocess.run(words, capture_output=True, text=True, check=True).stdout
    *_, line = (tmp_path / "points.ply").read_text().splitlines()
    assert [float(x) for x in line.split()] == pytest.approx([0, 1, -12.05, 1, 1, 1])


def test_few_gates_and_scans_of_a_wall(tmp_path):
    assert lidar_points.echoes(np.array([0.0, 0.0, 1.0, 0.0]), np.full(4, 1e-3), 10, 3)
    np.save(tmp_path / "wall.npy", np.ones((4, 2), np.float32))
    about = {"bin_width_opl": 0.1, "start_opl": 1, "laser": [0, 0, 0], "laser_points": [[0, 0, 1]] * 2, "samples": 4}
    (tmp_path / "wall.json").write_text(json.dumps({**about, "account_first_and_last_bounces": False}))
    run = subprocess.run([sys.executable, EXAMPLE, tmp_path / "wall.npy", tmp_path / "p.ply"], capture_output=True, text=True)
    assert run.returncode != 0 and "no scan of a LiDAR" in run.stderr
