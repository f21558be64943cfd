"""examples/lidar_points.py finds the surfaces of histograms that are made here, with the noise of a render of 64 samples per beam."""

import importlib.util
import json
import struct
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


def found(light, keep, variance=None, rule="centre"):
    noise = lidar_points.noise_of(light, SAMPLES, variance)
    beams = [lidar_points.echoes(seen, errors, 0.5 / WIDTH, 3, rule) for seen, errors in zip(light.T, noise.T)]
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
    header, record = (tmp_path / "points.ply").read_bytes().split(b"end_header\n")
    assert b"element vertex 1\nproperty double x\n" in header
    (point,) = np.frombuffer(record, lidar_points.FIELDS)
    assert list(point) == pytest.approx([0, 1, -12.05, 1, 1, 1, 0, 0, 0])


def test_a_pulse_has_its_position_by_each_rule():
    # A Gaussian pulse whose centre lies anywhere in a gate, and a slow tail behind it that moves the centre of the light.
    gates = START + WIDTH * (np.arange(GATES) + 0.5)
    centres = 20 + WIDTH * np.arange(BEAMS)[:, None] / BEAMS
    light = np.exp(-0.5 * ((gates - centres) / 0.15) ** 2).T
    half = 0.15 * np.sqrt(2 * np.log(2))
    tail = light + 0.3 * np.exp(-0.5 * ((gates - centres - 0.25) / 0.2) ** 2).T
    # The leading edge hardly notices the tail. Gates are 10 cm deep.
    for rule, offset, within, late in [("centre", 0, 0.013, 0.02), ("peak", 0, 0.003, 0.015), ("constant-fraction", -half, 0.012, 0.0)]:
        depths = np.array(found(light, "all", variance=0 * light, rule=rule))
        assert np.abs(depths - centres - offset).max() < within, rule
        moved = np.array(found(tail, "all", variance=0 * light, rule=rule)) - centres - offset
        assert moved.min() > late and (rule != "constant-fraction" or moved.max() < within), rule


def test_a_cloud_is_the_same_in_each_format(tmp_path):
    # Two channels and two steps of a LiDAR that drives, in front of grey walls of albedo 0.5.
    light = np.zeros((GATES, 4), np.float32)
    ranges, white, places = np.array([12.05, 20.05, 7.05, 30.05]), 40.0, np.array([[0, 0, 0], [0, 0, 0], [0, 0, -1], [0, 0, -1]])
    light[np.round((ranges - START) / WIDTH - 0.5).astype(int), range(4)] = 0.5 * white / ranges**2
    np.save(tmp_path / "scan.npy", light)
    about = {"laser": [0, 0, 0], "samples": SAMPLES, "account_first_and_last_bounces": True, "start_opl": 2 * START, "bin_width_opl": 2 * WIDTH}
    about |= {"laser_points": (places + [1, 0, 0]).tolist(), "laser_places": places.tolist(), "shot_times_s": [0.0, 0.0, 0.05, 0.05]}
    (tmp_path / "scan.json").write_text(json.dumps({**about, "laser_grid": [2, 2], "white_target_at_1m": white}))
    for name in ["a.npy", "a.ply", "a.las"]:
        subprocess.run([sys.executable, EXAMPLE, tmp_path / "scan.npy", tmp_path / name], check=True)
    points = np.load(tmp_path / "a.npy")
    assert points["x"] == pytest.approx(ranges) and points["z"].tolist() == [0, 0, -1, -1]
    assert points["intensity"] * ranges**2 == pytest.approx(0.5)
    assert points["time"].tolist() == [0.0, 0.0, 0.05, 0.05] and points["channel"].tolist() == [0, 1, 0, 1]
    assert (tmp_path / "a.ply").read_bytes().endswith(points.tobytes())
    las = (tmp_path / "a.las").read_bytes()
    count, length = struct.unpack_from("<Q", las, 247)[0], struct.unpack_from("<H", las, 105)[0]
    assert (las[:4], las[24:26], las[104], count, len(las)) == (b"LASF", b"\1\4", 6, 4, 375 + 4 * length)
    scale, offset = struct.unpack_from("<6d", las, 131)[::3]
    x, _, _, intensity, returns = struct.unpack_from("<iiiHB", las, 375 + length)
    assert (offset + scale * x, intensity / 65535, returns) == (pytest.approx(20.05), pytest.approx(0.5, abs=1e-4), 0x11)
    run = subprocess.run([sys.executable, EXAMPLE, tmp_path / "scan.npy", tmp_path / "scan.npy"], capture_output=True, text=True)
    assert run.returncode != 0 and "must not be the scan" in run.stderr and np.array_equal(np.load(tmp_path / "scan.npy"), light)


def test_few_gates_and_scans_of_a_wall(tmp_path):
    assert lidar_points.echoes(np.array([0.0, 0.0, 1.0, 0.0]), np.full(4, 1e-3), 10, 3)
    np.save(tmp_path / "wall.npy", np.ones((4, 2), np.float32))
    about = {"bin_width_opl": 0.1, "start_opl": 1, "laser": [0, 0, 0], "laser_points": [[0, 0, 1]] * 2, "samples": 4}
    (tmp_path / "wall.json").write_text(json.dumps({**about, "account_first_and_last_bounces": False}))
    run = subprocess.run([sys.executable, EXAMPLE, tmp_path / "wall.npy", tmp_path / "p.ply"], capture_output=True, text=True)
    assert run.returncode != 0 and "no scan of a LiDAR" in run.stderr
