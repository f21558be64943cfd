"""Scans: the same bits as the program, and files that tal opens."""

import json
import os
import resource
import signal
import zlib

import numpy as np
import pytest

import taugate
from conftest import SCENES

SCAN = f"""
scene = "{SCENES}/hidden-letter.glb"
[scan]
laser = [2, 0, 1.5]
POINTS
[gate]
gates = "1.9m..3.9m/10"
[render]
spp = 4
"""
GRID = "{ corner = [-0.8, 0.8, 0], across = [1.6, 0, 0], down = [0, -1.6, 0], count = [3, 2] }"
CONFOCAL = f"points = {GRID}"
EXHAUSTIVE = f"laser-points = {GRID}\nsensor-points = {GRID.replace('[3, 2]', '[2, 4]')}"
SINGLE = f"laser-points = [[0.1, 0, 0]]\nsensor-points = {GRID}"


def written(folder, points):
    path = folder / "scan.toml"
    path.write_text(SCAN.replace("POINTS", points))
    return path


def test_a_scan_has_the_bits_of_the_program(program, tmp_path):
    path = written(tmp_path, CONFOCAL)
    code, text = program("render", path, "-o", "cli.npy", "--variance")
    assert code == 0, text
    steps = []
    scan = taugate.scan(path, variance=True, progress=steps.append)
    program_scan = taugate.Scan.load(tmp_path / "cli.npy")
    assert np.array_equal(scan.data, program_scan.data) and scan.data.shape == (10, 6) and scan.data.any()
    assert np.array_equal(scan.variance, program_scan.variance)
    assert 1 <= len(steps) <= 6 and steps[-1].fraction == 1
    scan.save(tmp_path / "again.npy")
    assert np.array_equal(taugate.Scan.load(tmp_path / "again.npy").data, scan.data)
    assert np.allclose(scan.edges, np.linspace(1.9, 3.9, 11))


def test_a_lidar_on_a_car_has_a_place_and_a_time_per_shot(tmp_path):
    turn = (SCENES / "street-turn.toml").read_text().replace("steps = 1800", "steps = 4").replace("street", f"{SCENES}/street")
    (tmp_path / "turn.toml").write_text(turn)
    scan = taugate.scan(tmp_path / "turn.toml", gates="4m..144m/70", spp=4)
    about = scan.description
    assert scan.data.shape == (70, 128) and about["laser_grid"] == [32, 4] and about["white_target_at_1m"] > 0
    assert about["shot_times_s"][::32] == pytest.approx([0, 0.025, 0.05, 0.075])
    # 10 m/s forwards, on a circle.
    assert np.array(about["laser_places"])[96] == pytest.approx([-0.0098, 1.6, -0.75], abs=1e-3)
    with pytest.raises(taugate.SettingsError, match="this LiDAR moves"):
        scan.to_tal(tmp_path / "scan.hdf5")
    # The other car comes nearer from shot to shot, unless the scene stands still.
    (tmp_path / "still.toml").write_text(turn.replace('at = "1s"', ""))
    still = taugate.scan(tmp_path / "still.toml", gates="4m..144m/70", spp=4)
    assert still.data.any() and not np.array_equal(scan.data, still.data)
    moved = taugate.load(tmp_path / "turn.toml", moves=["car"])
    moved.set_transform("car", moved.transform("car"))
    with pytest.raises(taugate.SettingsError, match="do not move nodes"):
        taugate.scan(moved, gates="4m..144m/70", spp=4)


def test_a_lidar_records_velocities(program, tmp_path):
    turn = (SCENES / "street-turn.toml").read_text().replace("steps = 1800", "steps = 4").replace("street", f"{SCENES}/street")
    turn = turn.replace("azimuth = [0, 360]", "azimuth = [-4, -2]").replace("100ms", "1ms").replace("/700", "/70")
    (tmp_path / "turn.toml").write_text(turn)
    code, text = program("render", tmp_path / "turn.toml", "--doppler", "30m/s", "-o", "cli.npy")
    assert code == 0, text
    scan = taugate.scan(tmp_path / "turn.toml", doppler="30m/s")
    assert scan.velocity.shape == (70, 128, 2)
    lit = scan.data > 0
    assert np.array_equal(lit, np.isfinite(scan.velocity[..., 0]))
    # The other car comes at 17 m/s, and this one drives at 10 m/s.
    assert -28 < scan.velocity[lit][:, 0].min() < -26
    loaded = taugate.Scan.load(tmp_path / "cli.npy")
    assert np.array_equal(loaded.velocity, scan.velocity, equal_nan=True) and np.array_equal(loaded.data, scan.data)
    scan.save(tmp_path / "again.npy")
    assert np.array_equal(taugate.Scan.load(tmp_path / "again.npy").velocity, scan.velocity, equal_nan=True)
    scan.velocity = None
    scan.save(tmp_path / "again.npy")
    assert taugate.Scan.load(tmp_path / "again.npy").velocity is None


def test_layers_of_a_scan_stay_with_it(tmp_path):
    path = tmp_path / "scan.npy"
    description = {"laser_points": [[0, 0, 0]] * 2, "aov": ["range"], "unit": "W/(m^2 sr)", "shape": [3, 2]}
    layers = np.array([(1.5,), (2.5,)], dtype=[("range", "<f4")])
    taugate.Scan(np.ones((3, 2), np.float32), description, layers=layers).save(path)
    loaded = taugate.Scan.load(path)
    assert np.array_equal(loaded.layers, layers) and loaded.description["aov"] == ["range"]
    loaded.save(path)
    assert np.array_equal(taugate.Scan.load(path).layers, layers)
    loaded.layers = None
    loaded.save(path)
    assert taugate.Scan.load(path).layers is None and "aov" not in taugate.Scan.load(path).description
    assert sorted(os.listdir(tmp_path)) == ["scan.json", "scan.npy"]


def test_an_array_without_variances_leaves_no_older_variances(tmp_path):
    path = tmp_path / "scan.npy"
    description = {"laser_points": [[0, 0, 0]] * 2}
    first = taugate.Scan(np.ones((3, 2), np.float32), description, np.full((3, 2), 0.5, np.float32))
    first.save(path)
    assert np.array_equal(taugate.Scan.load(path).variance, first.variance)
    taugate.Scan(2 * first.data, description).save(path)
    assert taugate.Scan.load(path).variance is None
    assert sorted(os.listdir(tmp_path)) == ["scan.json", "scan.npy"]


def test_an_array_of_another_scan_is_refused(tmp_path):
    path = tmp_path / "scan.npy"
    scan = taugate.Scan(np.ones((3, 2), np.float32), {"laser_points": [[0, 0, 0]] * 2}, np.ones((3, 2), np.float32))
    scan.save(path)
    # What was loaded can be saved again.
    taugate.Scan.load(path).save(path)
    taugate.Scan.load(path)
    # A program that knows nothing of the JSON file writes another array under this name.
    np.save(path, np.ones((4, 2), np.float32))
    with pytest.raises(taugate.FileError, match="does not belong to .*scan.json"):
        taugate.Scan.load(path)
    # Earlier versions recorded no check sums.
    about = json.loads((tmp_path / "scan.json").read_text())
    recorded = about.pop("files")
    assert int(recorded["variance"]["crc32"], 16) == zlib.crc32((tmp_path / "scan.variance.npy").read_bytes())
    (tmp_path / "scan.json").write_text(json.dumps(about))
    assert taugate.Scan.load(path).variance is None


def test_a_scan_that_cannot_be_written_leaves_the_older_files(tmp_path, monkeypatch):
    h5py = pytest.importorskip("h5py")
    points = [[0, 0, 0], [1, 0, 0]]
    description = {"laser_points": points, "sensor_points": points, "laser_grid": None, "sensor_grid": None, "laser": [0, 0, 1]}
    description |= {"sensor": [0, 0, 1], "start_opl": 0, "bin_width_opl": 1, "temporal_bins": 3, "version": "1", "unit": "W"}
    description["account_first_and_last_bounces"] = True
    scan = taugate.Scan(np.ones((3, 2), np.float32), description, np.ones((3, 2), np.float32))
    scan.save(tmp_path / "scan.npy")
    scan.to_tal(tmp_path / "scan.hdf5")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    other = taugate.Scan(np.zeros((3, 2), np.float32), {**description, "bin_width_opl": 2})

    def fail(*_):
        raise OSError("no space left")

    monkeypatch.setattr(h5py.File, "__setitem__", fail)
    with pytest.raises(OSError, match="no space left"):
        other.to_tal(tmp_path / "scan.hdf5")
    # No file of the test may grow beyond the limit. Each file is smaller than it, so the JSON file is what fails.
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    large = taugate.Scan(other.data, {**other.description, "settings": "x" * 20_000})
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
        with pytest.raises(taugate.FileError, match="scan.json: cannot be written"):
            large.save(tmp_path / "scan.npy")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("points, shape", [(CONFOCAL, (10, 3, 2)), (EXHAUSTIVE, (10, 3, 2, 2, 4)), (SINGLE, (10, 3, 2))])
def test_tal_opens_a_scan(tmp_path, points, shape):
    h5py = pytest.importorskip("h5py")
    scan = taugate.scan(written(tmp_path, points), spp=1)
    scan.to_tal(tmp_path / "scan.hdf5")
    with h5py.File(tmp_path / "scan.hdf5") as file:
        assert file["H"].shape == shape and file["H"].dtype == np.float32
        assert file["t_start"][()] == np.float32(1.9) and np.isclose(file["delta_t"][()], 0.2)
        grid, normals, H = (file[key][()] for key in ("sensor_grid_xyz", "sensor_grid_normals", "H"))
    # Axis x of the grid goes to the right, axis y down, as the scan does.
    assert (np.diff(grid[..., 0], axis=0) > 0).all() and (np.diff(grid[..., 1], axis=1) < 0).all()
    assert np.allclose(normals, (0, 0, 1))
    if scan.is_confocal:
        # The point in column 2 of row 1 is the last one.
        assert np.allclose(H[:, 2, 1], 3 * scan.data[:, 5])
    elif len(shape) == 5:
        # Point 4 of the laser is in column 1 of row 1, and point 3 of the sensor in column 1 of row 1.
        assert np.allclose(H[:, 1, 1, 1, 1], 3 * scan.data[:, 4, 3])
    tal = pytest.importorskip("tal", reason="y-tal is not installed")
    capture = tal.io.read_capture(str(tmp_path / "scan.hdf5"))
    assert capture.H.shape == shape and capture.H_format.name == ("T_Lx_Ly_Sx_Sy" if len(shape) == 5 else "T_Sx_Sy")
    assert capture.is_confocal() == scan.is_confocal
    assert np.allclose(capture.laser_xyz, (2, 0, 1.5)) and not capture.t_accounts_first_and_last_bounces


def test_tal_opens_a_scan_of_lists(tmp_path):
    h5py = pytest.importorskip("h5py")
    lasers, sensors = [[0.1, 0, 0], [-0.3, 0.2, 0]], [[0, 0, 0], [0.5, 0, 0], [0.5, 0.5, 0]]
    scan = taugate.scan(written(tmp_path, f"laser-points = {lasers}\nsensor-points = {sensors}"), spp=1)
    scan.to_tal(tmp_path / "scan.hdf5")
    with h5py.File(tmp_path / "scan.hdf5") as file:
        assert np.array_equal(file["H"], 3 * scan.data) and file["H"].shape == (10, 2, 3)
        assert np.allclose(file["laser_grid_xyz"], lasers) and np.allclose(file["sensor_grid_xyz"], sensors)


def test_an_interrupted_scan_keeps_its_points(tmp_path, interrupting):
    path = written(tmp_path, CONFOCAL)
    scene = taugate.load(path)
    with pytest.raises(taugate.Interrupted) as stopped:
        # Each of the six points takes 2 s.
        taugate.scan(scene, time=12, progress=interrupting)
    scan = stopped.value.image
    assert np.isfinite(scan.data[:, 0]).all() and np.isnan(scan.data[:, -1]).all()


def test_mistakes_of_scans_are_explained(box, tmp_path):
    with pytest.raises(taugate.SettingsError, match="is no scan"):
        taugate.scan(box)
    with pytest.raises(taugate.SettingsError, match="measure it with taugate.scan"):
        taugate.render(written(tmp_path, CONFOCAL))
    off = CONFOCAL.replace("0.8, 0]", "0.8, 0.5]")
    with pytest.raises(taugate.SettingsError, match="are not on a surface"):
        taugate.scan(written(tmp_path, off))
