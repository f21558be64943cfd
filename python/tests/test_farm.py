"""A farm of workers on this machine."""

import json
import os
import pathlib
import pickle
import shutil
import signal
import subprocess
import sys
import threading
import time
import types
import zipfile

import numpy as np
import pytest

import taugate

from conftest import SCENES, SIZE, quad

distributed = pytest.importorskip("distributed")

SETTINGS = dict(resolution=SIZE, gate="5m..6m", light_paths=1000, sampling="uniform")


@pytest.fixture(scope="module")
def cluster():
    # Few processes, because each of them compiles the kernels. Any free port: another process runs a cluster of the documentation.
    with distributed.LocalCluster(n_workers=4, threads_per_worker=1, dashboard_address=":0", processes=True) as cluster:
        with distributed.Client(cluster) as client:
            yield client


def contents(path):
    """The description of the render in a file of sums, and the bytes of the arrays by their names."""
    with zipfile.ZipFile(path) as file:
        arrays = {name: file.read(name) for name in file.namelist()}
    return json.loads(arrays.pop("about.json")), arrays


def by_hand(scene, spp, ranges):
    """The sums of these parts, added in order."""
    native, flags = taugate.load(scene)._job(SETTINGS, "test")
    total = None
    for begin, end in ranges:
        part = taugate._native.Sums.from_bytes(taugate._native.accumulate(native, flags, "x", begin, end, spp)[0])
        if total is None:
            total = part
        else:
            total.merge(part)
    return taugate.Image(taugate._native.image_of_sums(native, flags, total, 0))


def test_a_killed_worker_changes_no_bit(cluster):
    scene = SCENES / "cornell-box.glb"
    pids = cluster.run(os.getpid)
    updates = []

    def update(image):
        updates.append((image.samples, float(np.sqrt(image.variance.mean()) / image.pixels.mean())))
        if len(updates) == 2:
            os.kill(next(iter(pids.values())), signal.SIGKILL)

    from taugate import farm

    image = farm.render(scene, client=cluster, spp=400, part_seconds=0.2, on_update=update, **SETTINGS)
    assert image.samples == 400 and len(updates) > 5
    assert set(cluster.run(os.getpid).values()) != set(pids.values()), "no worker was killed"
    # The error bar falls.
    assert updates[-1][1] < 0.5 * updates[0][1]
    alone = taugate.render(scene, spp=400, **SETTINGS)
    assert image.pixels.tobytes() == alone.pixels.tobytes()
    assert np.allclose(image.variance, alone.variance, rtol=1e-6)
    whole = by_hand(scene, 400, [(0, 7), (7, 20), (20, 62)])
    assert image.pixels.tobytes() == whole.pixels.tobytes() and image.variance.tobytes() == whole.variance.tobytes()


def test_another_worker_repeats_the_part_of_a_slow_one(cluster, monkeypatch, tmp_path):
    from taugate import farm

    accumulate, patience, started = farm.accumulate, 60, time.monotonic()

    def slow_at_first(key, payload, files, settings, contents, begin, *more):
        try:
            (tmp_path / f"began-{begin}").touch(exist_ok=False)
        except FileExistsError:
            pass
        else:
            # The first worker that gets this part hangs until the end of the test.
            hangs = time.monotonic()
            while begin == 2 and not (tmp_path / "over").exists() and time.monotonic() - hangs < patience:
                time.sleep(0.05)
        return accumulate(key, payload, files, settings, contents, begin, *more)

    monkeypatch.setattr(farm, "accumulate", slow_at_first)
    scene = SCENES / "cornell-box.glb"
    image = farm.render(scene, client=cluster, spp=100, part_seconds=0.001, **SETTINGS)
    assert (tmp_path / "began-2").exists() and time.monotonic() - started < patience
    (tmp_path / "over").touch()
    assert image.samples == 100 and image.pixels.tobytes() == taugate.render(scene, spp=100, **SETTINGS).pixels.tobytes()


def test_the_scheduler_is_asked_for_its_workers_once_per_second(monkeypatch):
    from taugate import farm

    class Client:
        asked = 0

        def scheduler_info(self, n_workers):
            self.asked += 1
            return {"workers": {name: {"nthreads": self.asked} for name in "ab"}}

    now, client = [100.0], Client()
    monkeypatch.setattr(farm, "clock", types.SimpleNamespace(monotonic=lambda: now[0]))
    assert [farm._threads(client) for _ in range(3)] == [2, 2, 2]
    now[0] += 0.9
    assert (farm._threads(client), client.asked) == (2, 1)
    now[0] += 0.2
    assert (farm._threads(client), client.asked) == (4, 2)


def test_an_error_or_a_time_ends_a_render(cluster):
    from taugate import farm

    scene = taugate.load(SCENES / "cornell-box.glb", **SETTINGS)
    image = farm.render(scene, client=cluster, error="10%", part_seconds=0.2)
    assert np.sqrt(image.variance.mean()) <= 0.1 * image.pixels.mean() and image.iterations >= farm.MIN_ITERATIONS
    assert f"spp = {image.samples}\n" in image.settings
    started = time.monotonic()
    image = farm.render(scene, client=cluster, time="1000ms", part_seconds=0.2)
    assert image.samples > 0 and time.monotonic() - started < 60


@pytest.mark.parametrize("settings", [dict(error=0.1), dict(time=1.0)])
def test_a_render_whose_parts_all_fail_ends(cluster, monkeypatch, settings):
    from taugate import farm

    def fail(*_):
        raise MemoryError("no room")

    monkeypatch.setattr(farm, "accumulate", fail)
    with pytest.raises(taugate.Error, match="no part of the render succeeded; the last one failed with: no room"):
        farm.render(SCENES / "cornell-box.glb", client=cluster, **settings, **SETTINGS)


def fail_later(key, payload, files, settings, contents, begin, *more):
    from taugate import farm

    if begin > 0:
        raise MemoryError("no room")
    return farm.accumulate(key, payload, files, settings, contents, begin, *more)


@pytest.mark.parametrize("settings", [dict(error=1e-9), dict(spp=200)])
def test_parts_that_are_left_out_are_counted(cluster, monkeypatch, settings):
    from taugate import farm

    cloudpickle = pytest.importorskip("cloudpickle")
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    accumulate = farm.accumulate
    monkeypatch.setattr(farm, "accumulate", fail_later)
    with pytest.warns(UserWarning, match=r"\d+ parts of the render failed and were left out; the last one failed with: no room"):
        image = farm.render(SCENES / "cornell-box.glb", client=cluster, **settings, **SETTINGS)
    assert image.samples == 4 and accumulate is not fail_later


def test_a_black_image_ends_a_render(cluster):
    from taugate import farm

    scene = only_a_lamp(gate="7m..8m")
    for settings in (dict(error=0.1), dict(spp=8)):
        with pytest.raises(taugate.SettingsError, match="no sample fell inside"):
            farm.render(scene, client=cluster, part_seconds=0.01, **settings)


def test_workers_notice_other_files(cluster, tmp_path):
    from taugate import _worker, farm

    path = tmp_path / "scene.toml"
    first, second = (SCENES / f"{name}.glb" for name in ("cornell-box", "hidden-letter"))
    shutil.copy(first, tmp_path / "scene.glb")
    path.write_text('scene = "scene.glb"')
    settings = dict(client=cluster, spp=4, resolution=(8, 8), light_paths=500, sampling="uniform")
    before = farm.render(path, **settings)
    shutil.copy(second, tmp_path / "scene.glb")
    after = farm.render(path, **settings)
    alone = taugate.render(path, **{key: value for key, value in settings.items() if key != "client"})
    assert (after.pixels == alone.pixels).all() and (after.pixels != before.pixels).any()
    # A worker that has other files than the client.
    job = farm._Job(path, {}, 4)
    shutil.copy(first, tmp_path / "scene.glb")
    with pytest.raises(taugate.FileError, match="has other contents than where the render was started"):
        _worker._job(job.key, job.payload, job.files, job.settings)


def test_a_scene_that_workers_have_lost_is_sent_again(cluster):
    from taugate import farm

    job = farm._Job(SCENES / "cornell-box.glb", {}, 4)
    sent = farm._sent(cluster, job)
    assert farm._sent(cluster, job) is sent
    cluster.cancel([sent])
    again = farm._sent(cluster, job)
    assert again is not sent and again.result() == job.payload


def only_a_lamp(**settings):
    """The camera sees nothing but the front of a lamp at 5.5 m, so each sample has the same radiance."""
    scene = taugate.Scene(**{**SETTINGS, **settings})
    scene.add_mesh("lamp", *quad((0, 0, -5.5), (40, 0, 0), (0, 40, 0)), taugate.Material.emitter(2))
    scene.add_camera("front", taugate.Camera.look_at((0, 0, 0), (0, 0, -1), fov=1, resolution=SIZE))
    return scene


def test_an_image_without_noise_ends_a_render(cluster):
    from taugate import farm

    scene, shown = only_a_lamp(), []
    image = farm.render(scene, client=cluster, error=0.1, part_seconds=0.2, progress=shown.append)
    assert image.variance.max() == 0 and np.allclose(image.pixels, 2)
    assert shown[-1].fraction == 1


def test_histograms_and_mistakes(cluster):
    from taugate import farm

    scene = taugate.load(SCENES / "cornell-box.glb", resolution=(16, 12), light_paths=500, sampling="uniform")
    settings = dict(gates="4m..8m/6", spp=24)
    histogram = farm.render(scene, client=cluster, part_seconds=0.2, **settings)
    alone = taugate.histogram(scene, **settings)
    assert histogram.pixels.shape == (12, 16, 6, 3)
    assert np.allclose(histogram.pixels, alone.pixels, rtol=1e-6)
    with pytest.raises(taugate.SettingsError, match="no unit"):
        farm.render(scene, client=cluster, gate="1..2")


def test_what_a_farm_cannot_do_is_refused_before_it_works(tmp_path):
    from taugate import farm

    scene = taugate.load(SCENES / "cornell-box.glb", **SETTINGS)
    (tmp_path / "scan.toml").write_text(
        f"""scene = "{SCENES / 'cornell-box.glb'}"
[scan]
laser = [0, 1, 1]
points = {{ corner = [-0.2, 0.8, -0.5], across = [0.4, 0, 0], down = [0, -0.4, 0], count = [2, 2] }}
[gate]
gates = "4m..8m/4"
"""
    )
    # The refusal comes before the client is used, so None is enough.
    with pytest.raises(taugate.SettingsError, match="scan; measure it with taugate.scan"):
        farm.render(tmp_path / "scan.toml", client=None)
    with pytest.raises(taugate.SettingsError, match="no auxiliary layers; leave out aov"):
        farm.render(scene, client=None, aov="depth")
    with pytest.raises(taugate.SettingsError, match="leave out strict"):
        farm.render(scene, client=None, strict=True)
    with pytest.raises(taugate.SettingsError, match="renders a single moment"):
        farm.render(SCENES / "street.glb", client=None, shutter="0..20ms")
    for wrong in (dict(error=0), dict(error="a lot"), dict(spp=0), dict(spp="64"), dict(time="8"), dict(time=-1)):
        with pytest.raises(taugate.SettingsError, match="above 0|duration"):
            farm.render(scene, client=None, **wrong)


def test_sums_and_grids(cluster, tmp_path, program):
    from taugate import farm

    # Sampling is adaptive, and the settings of the scene decide when the render ends.
    small = dict(gate="5m..6m", resolution=(16, 12), light_paths=500)
    scene = taugate.load(SCENES / "cornell-box.glb", spp=12, **small)
    image = farm.render(scene, client=cluster, part_seconds=0.2)
    assert image.samples == 12
    image.save(tmp_path / "a.acc")
    copy = pickle.loads(pickle.dumps(image))
    copy.save(tmp_path / "b.acc")
    (about, arrays), (other, same) = (contents(tmp_path / name) for name in ("a.acc", "b.acc"))
    assert arrays == same
    # The program reads a decimal number to within a unit of the last place.
    assert about.pop("seconds") == pytest.approx(other.pop("seconds"), rel=1e-15)
    assert about == other
    code, message = program("develop", "a.acc", "-o", "a.npy")
    assert code == 0, message
    assert (np.load(tmp_path / "a.npy") == image.pixels).all() and image.pixels.any()
    # The program recognizes the scene, and continues the render.
    code, message = program("render", "--resume", "a.acc", "--spp", "20", "-o", "more.npy")
    assert code == 0 and "going on after 12 samples" in message and "state of adaptive sampling" in message, message

    fog = dict(sigma_s=0.1, medium_bounds=(-1, 0, -1, 1, 2, 1), density_grid=np.full((2, 2, 2), 0.5), sampling="uniform", spp=8)
    clouds = farm.render(scene, client=cluster, part_seconds=0.2, **fog)
    assert np.allclose(clouds.pixels, taugate.render(scene, **fog).pixels, rtol=1e-6) and clouds.pixels.any()


def test_a_data_set_is_continued(cluster, tmp_path):
    from taugate import _files, farm

    scene = taugate.load(SCENES / "cornell-box.glb", **SETTINGS)
    jobs = [(f"seed{seed}", scene, dict(seed=seed, spp=2)) for seed in range(3)]
    outside = [("../seed8", scene, dict(spp=2)), (str(tmp_path / "seed8"), scene, {}), ("", scene, {}), (8, scene, {})]
    inside = [("train/a/seed9", scene, dict(spp=2))]
    made = []
    with pytest.raises(taugate.SettingsError, match="'../seed8', but must be a text such as 'seed1' or 'train/seed1' that stays"):
        for path in farm.dataset(outside[:1] + jobs[:2] + outside[1:] + inside, client=cluster, folder=tmp_path):
            made.append(path)
    made.sort()
    assert [os.path.relpath(path, tmp_path) for path in made] == ["seed0.npy", "seed1.npy", "train/a/seed9.npy"]
    assert (tmp_path / "train/a/seed9.exr").exists() and not list(tmp_path.parent.glob("seed8*"))
    assert not list(tmp_path.glob("seed8*"))
    first = os.stat(made[0]).st_mtime_ns
    assert len(list(farm.dataset(iter(jobs), client=cluster, folder=tmp_path))) == 3
    assert os.stat(made[0]).st_mtime_ns == first, "what is there is kept"
    assert (np.load(tmp_path / "seed2.npy") == taugate.render(scene, seed=2, spp=2).pixels).all()
    os.remove(made[1])
    jobs[:0] = [("broken", scene, dict(gate="1..2", spp=2)), ("missing", tmp_path / "missing.glb", {})]
    jobs += [("cw", scene, dict(cw="20", spp=2))]
    abandoned = tmp_path / f".seed9.npy-x{_files.PARTIAL}"
    abandoned.write_text("half")
    os.utime(abandoned, (0, 0))
    made = []
    before = os.umask(0o027)
    try:
        with pytest.raises(taugate.SettingsError, match="no unit"):
            for path in farm.dataset(jobs, client=cluster, folder=tmp_path):
                made.append(pathlib.Path(path).name)
    finally:
        os.umask(before)
    assert sorted(made) == ["cw.npy", "seed0.npy", "seed1.npy", "seed2.npy"]
    assert (tmp_path / "seed1.npy").stat().st_mode & 0o777 == 0o640 and not abandoned.exists()
    assert np.load(tmp_path / "cw.npy").ndim == 4


LEAVE_FILES = """
import pathlib, sys
from taugate import _worker, farm
for number in range(farm.KEPT + 1):
    job = farm._Job(sys.argv[1], {}, None)
    scene = _worker._scene(str(number), job.payload)
    if number == 0:
        # As a render does whose scene a later scene displaces.
        used = scene
kept = list(pathlib.Path(sys.argv[2]).glob("taugate-*/scene.glb"))
del used
print(len(kept), len(list(pathlib.Path(sys.argv[2]).glob("taugate-*"))))
"""


def test_a_worker_leaves_no_scene_files(tmp_path):
    from taugate import farm

    words = [sys.executable, "-c", LEAVE_FILES, SCENES / "cornell-box.glb", tmp_path]
    done = subprocess.run(words, cwd=tmp_path, env={**os.environ, "TMPDIR": str(tmp_path)}, capture_output=True, text=True)
    assert done.stdout.split() == [str(farm.KEPT + 1), str(farm.KEPT)], done.stderr
    assert not list(tmp_path.iterdir()), "nothing is left at exit"


@pytest.mark.parametrize("suffix", [".png", "npy", ""])
def test_a_data_set_refuses_files_that_it_does_not_write(tmp_path, suffix):
    from taugate import farm

    with pytest.raises(taugate.SettingsError, match="must be '.npy' or '.exr'"):
        farm.dataset([], client=None, folder=tmp_path / "new", suffix=suffix)
    assert not (tmp_path / "new").exists()


def test_a_data_set_of_images_leaves_out_a_histogram(cluster, tmp_path):
    from taugate import farm

    scene = taugate.load(SCENES / "cornell-box.glb", resolution=SIZE, light_paths=1000, spp=2)
    jobs = [("image", scene, dict(gate="5m..6m")), ("histogram", scene, dict(gates="5m..6m/2"))]
    made = []
    with pytest.raises(taugate.SettingsError, match="histogram.exr was not written"):
        for path in farm.dataset(jobs, client=cluster, folder=tmp_path, suffix=".exr"):
            made.append(pathlib.Path(path).name)
    assert made == ["image.exr"] and (tmp_path / "image.exr").exists()
