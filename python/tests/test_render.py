"""Renders of files have the same bits and the same error messages as those of the program."""

import gc
import json
import os
import pickle
import subprocess
import sys
import threading
import time
import weakref

import numpy as np
import pytest

import taugate
from conftest import SCENES, SIZE, room
from taugate import _render

BOX = SCENES / "cornell-box.glb"


def test_an_image_has_the_bits_of_the_program(box, program, tmp_path):
    words = ["--gate", "6m..7m", "--spp", 4, "--resolution", "32x32", "--variance"]
    code, text = program("render", BOX, *words, "-o", "cli.npy")
    assert code == 0, text
    image = taugate.render(box, gate="6m..7m", spp=4)
    assert image.pixels.shape == (32, 32, 3) and image.pixels.dtype == np.float32
    assert image.pixels.any()
    assert np.array_equal(image.pixels, np.load(tmp_path / "cli.npy"))
    assert np.array_equal(image.variance, np.load(tmp_path / "cli.variance.npy"))
    assert (image.gate, image.samples) == ((6.0, 7.0), 4)
    # Counterexample: another seed has other bits.
    assert not np.array_equal(taugate.render(box, gate="6m..7m", spp=4, seed=1).pixels, image.pixels)


def test_a_shutter_blurs_what_moves(program, tmp_path):
    street = taugate.load(SCENES / "street.glb")
    settings = {"at": 1, "depth": "20m..60m", "spp": 32, "resolution": (32, 18)}
    image = taugate.render(street, **settings, shutter="0..300ms", rolling="5ms")
    words = ["--at", 1, "--depth", "20m..60m", "--spp", 32, "--resolution", "32x18", "--shutter", "0..300ms", "--rolling", "5ms"]
    code, text = program("render", SCENES / "street.glb", *words, "-o", "cli.npy")
    assert code == 0, text
    assert np.array_equal(image.pixels, np.load(tmp_path / "cli.npy")) and image.pixels.any()
    assert not np.array_equal(taugate.render(street, **settings).pixels, image.pixels)
    with pytest.raises(taugate.SettingsError, match="leave out --shutter"):
        taugate.render(SCENES / "cornell-box.glb", shutter="0..20ms", spp=1)
    with pytest.raises(taugate.SettingsError, match="add --shutter"):
        taugate.render(street, rolling="1ms", spp=1)
    moved = taugate.load(SCENES / "street.glb", moves=["car"])
    moved.set_transform("car", moved.transform("car"))
    with pytest.raises(taugate.SettingsError, match="do not move nodes"):
        taugate.render(moved, at=1, shutter="0..20ms", spp=1)


def test_velocities_are_recorded(program, tmp_path):
    street = taugate.load(SCENES / "street.glb")
    settings = {"at": 1, "spp": 8, "resolution": (64, 36), "max_depth": 2}
    pixels = taugate.render(street, **settings, doppler="20m/s").pixels.astype(float)
    words = ["--at", 1, "--spp", 8, "--resolution", "64x36", "--max-depth", 2, "--doppler", "20m/s"]
    code, text = program("render", SCENES / "street.glb", *words, "-o", "cli.npy")
    assert code == 0 and np.array_equal(pixels, np.load(tmp_path / "cli.npy")), text
    red, green, blue = np.moveaxis(pixels, -1, 0)
    light = red + 2 * green + blue
    velocity = 20 * (red - blue)[light > 0] / light[light > 0]
    assert velocity.min() < -10 and abs(np.median(velocity)) < 1e-3
    beats = taugate.histogram(street, **settings, fmcw="905nm,10GHz,10us", gates="0..120m/40")
    assert beats.pixels.any()
    moved = taugate.load(SCENES / "street.glb", moves=["car"])
    moved.set_transform("car", moved.transform("car"))
    with pytest.raises(taugate.SettingsError, match="leave out doppler and fmcw, or do not move nodes"):
        taugate.render(moved, at=1, doppler="20m/s", spp=1)


def test_fireflies_are_damped_beside_the_unbiased_image(box):
    settings = {"gate": "5m..5.1m", "spp": 16, "estimator": "pt"}
    keep, damp = (taugate.render(box, **settings, fireflies=fireflies) for fireflies in ("keep", "damp"))
    assert keep.undamped is None
    assert np.array_equal(damp.undamped, keep.pixels) and np.array_equal(damp.variance, keep.variance)
    assert (damp.pixels <= keep.pixels).all() and (damp.pixels < keep.pixels).any()
    with pytest.raises(taugate.SettingsError, match="only for a single gate"):
        taugate.histogram(box, gates=(5, 9, 8), spp=4, fireflies="damp")


def test_a_histogram_has_the_bits_and_the_description_of_the_program(box, program, tmp_path):
    code, text = program("render", BOX, "--gates", "5m..9m/8", "--spp", 4, "--resolution", "32x32", "-o", "cli.npy")
    assert code == 0, text
    histogram = taugate.histogram(box, gates=(5, 9, 8), spp=4)
    assert np.array_equal(histogram.pixels, np.load(tmp_path / "cli.npy"))
    assert histogram.pixels.shape == (32, 32, 8, 3) and histogram.variance is None
    assert np.allclose(histogram.edges, np.linspace(5, 9, 9))
    histogram.save(tmp_path / "python.npy")
    of_program, of_python = (json.loads((tmp_path / f"{name}.json").read_text()) for name in ("cli", "python"))
    for volatile in ("seconds", "settings"):
        del of_program[volatile], of_python[volatile]
    assert of_program == of_python and of_python["temporal_bins"] == 8
    steady, transient = histogram.to_mitransient()
    assert steady.shape == (32, 32, 3) and transient.shape == (32, 32, 8, 3)
    assert histogram.mitransient_film() == {"start_opl": 5, "bin_width_opl": 0.5, "temporal_bins": 8}


def test_a_gate_may_end_at_infinity(box):
    for begin in (5, 5.0, np.float32(5)):
        late = taugate.render(box, gate=(begin, np.inf), spp=2)
        assert late.gate == (5.0, np.inf)
        assert np.array_equal(late.pixels, taugate.render(box, gate="5m..inf", spp=2).pixels)
    # The gate of an image without a gate makes the same image.
    steady = taugate.render(box, spp=2)
    assert np.array_equal(taugate.render(box, gate=steady.gate, spp=2).pixels, steady.pixels)
    assert not np.array_equal(late.pixels, steady.pixels)


def test_renders_after_one_another_have_the_bits_of_new_scenes(box):
    taugate.render(box, gate="5m..6m", spp=2)
    for settings in ({"gate": "6m..7m"}, {"seed": 3, "gate": "6m..7m"}, {"spp": 3}, {"gates": "5m..9m/4"}, {"aov": "depth", "spp": 2}):
        again = taugate.load(BOX, resolution=SIZE)
        render = taugate.histogram if "gates" in settings else taugate.render
        assert np.array_equal(render(box, **{"spp": 2, **settings}).pixels, render(again, **{"spp": 2, **settings}).pixels), settings


def test_files_are_those_of_the_program(box, program, tmp_path):
    image = taugate.render(box, spp=2, aov="all")
    for name in ("x.exr", "x.png", "x.npy"):
        image.save(tmp_path / name)
    assert np.array_equal(np.load(tmp_path / "x.npy"), image.pixels)
    assert (tmp_path / "x.png").read_bytes()[1:4] == b"PNG"
    code, text = program("compare", "x.exr", "x.exr")
    assert code == 0, text
    words = ["--spp", 2, "--resolution", "32x32", "--aov", "all"]
    code, text = program("render", BOX, *words, "-o", "cli.exr", "--png")
    assert code == 0, text
    assert (tmp_path / "x.png").read_bytes() == (tmp_path / "cli.png").read_bytes()
    with pytest.raises(taugate.SettingsError, match="must end in .exr, .npy, .png or .acc"):
        image.save(tmp_path / "x.tif")
    with pytest.raises(taugate.FileError):
        image.save(tmp_path / "no folder" / "x.exr")


def test_a_saved_histogram_without_variances_leaves_no_older_variances(box, tmp_path):
    settings = dict(gates="5m..9m/4", spp=2)
    taugate.histogram(box, variance=True, **settings).save(tmp_path / "h.npy")
    assert (tmp_path / "h.variance.npy").exists()
    # There is nothing to remove the second time.
    for _ in range(2):
        taugate.histogram(box, seed=1, **settings).save(tmp_path / "h.npy")
        assert not (tmp_path / "h.variance.npy").exists() and (tmp_path / "h.json").exists()


def test_settings_are_an_experiment_of_the_program(box, program, tmp_path):
    image = taugate.render(box, gate="6m..7m", spp=2, lamp=[(0, 1, 0, 5), (0.5, 1, 0, 3)], emitters=["light", "lamp-2"])
    (tmp_path / "again.toml").write_text(image.settings)
    code, text = program("render", "again.toml", "-o", "again.npy")
    assert code == 0, text
    assert np.array_equal(np.load(tmp_path / "again.npy"), image.pixels)
    assert np.array_equal(taugate.render(taugate.load(tmp_path / "again.toml")).pixels, image.pixels)


MISTAKES = [
    ({"gate": "1..2"}, ["--gate", "1..2"]),
    ({"gate": "90m..91m"}, ["--gate", "90m..91m"]),
    ({"spp": 0}, ["--spp", "0"]),
    ({"estimator": "magic"}, ["--estimator", "magic"]),
    ({"camera": "side"}, ["--camera", "side"]),
    ({"emitters": "sun"}, ["--emitters", "sun"]),
    ({"resolution": (0, 5)}, ["--resolution", "0x5"]),
]


@pytest.mark.parametrize("settings, words", MISTAKES, ids=lambda value: str(value)[:30])
def test_a_mistake_has_the_sentence_of_the_program(box, program, settings, words):
    size = [] if "resolution" in settings else ["--resolution", "32x32"]
    code, text = program("render", BOX, *words, *size, "-o", "x.exr")
    assert code == 2
    with pytest.raises(taugate.Error) as error:
        taugate.render(box, **settings)
    assert str(error.value) in text, text
    assert isinstance(error.value, ValueError)


def test_mistakes_of_python_are_explained(box):
    with pytest.raises(TypeError, match="render\\(\\) has no setting 'gte'; did you mean gate"):
        taugate.render(box, gte="1m..2m")
    with pytest.raises(TypeError, match="no setting 'output'"):
        taugate.render(box, output="x.exr")
    with pytest.raises(taugate.SettingsError, match="cannot be used with") as caught:
        taugate.render(box, gate="1m..2m", depth="1m..2m")
    assert (caught.value.setting, caught.value.remedy) == ("depth", "keep one")
    with pytest.raises(taugate.SettingsError, match="invalid value '200' for '--fov") as caught:
        taugate.render(box, fov=200)
    assert (caught.value.setting, caught.value.remedy) == ("fov", "write degrees between 0 and 180, like 40")
    with pytest.raises(taugate.SettingsError, match="--max-depth is 0; it must be") as caught:
        taugate.render(box, max_depth=0)
    assert caught.value.setting == "max_depth" and caught.value.remedy.startswith("it must be from 1 to ")
    with pytest.raises(taugate.SettingsError, match="use taugate.histogram"):
        taugate.render(box, gates="5m..9m/8")
    with pytest.raises(taugate.SettingsError, match="needs gates"):
        taugate.histogram(box)
    with pytest.raises(taugate.SettingsError, match="gate is a dict"):
        taugate.render(box, gate={})
    with pytest.raises(taugate.FileError, match="no such file"):
        taugate.load("missing.toml")
    with pytest.raises(taugate.SceneError, match="missing.glb"):
        taugate.load("missing.glb")
    with pytest.raises(taugate.FileError, match="neither a scene"):
        taugate.load("x.obj")


def test_messages_do_not_command_the_terminal(box, tmp_path):
    """Names of files, and keys in them, may hold characters that a terminal obeys."""
    path = tmp_path / "a\x1b[2Jb.toml"
    path.write_text('"key\\u001b[31m" = 1', encoding="utf-8")
    for call in (lambda: taugate.load(path), lambda: taugate.load(tmp_path / "\x1b[2J.glb"), lambda: taugate.render(box, camera="\x9b2J")):
        with pytest.raises(taugate.Error) as error:
            call()
        assert "\x1b" not in str(error.value) and "\x9b" not in str(error.value) and "\\u00" in str(error.value), error.value


def test_no_driver_is_one_exception_that_names_the_remedy(tmp_path):
    code = "import taugate, sys; s = taugate.load(sys.argv[1]); s.info(); print('imported'); taugate.render(s, spp=1)"
    environment = {**os.environ, "VK_DRIVER_FILES": "/nowhere", "VK_ICD_FILENAMES": "/nowhere"}
    command = [sys.executable, "-c", code, str(BOX)]
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout == "imported\n"
    assert "DeviceError" in done.stderr and "setup.sh" in done.stderr, done.stderr


def test_progress_is_reported_and_an_exception_in_it_ends_the_render(box):
    steps = []
    taugate.render(box, spp=6, progress=steps.append)
    # A slow machine may leave out steps, but not the last one.
    assert {step.samples for step in steps} <= {2, 4, 6} and (steps[-1].samples, steps[-1].fraction) == (6, 1.0)

    def stop(step):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        taugate.render(box, spp=1000, progress=stop)
    # The scene still works.
    assert taugate.render(box, spp=2).samples == 2


@pytest.mark.parametrize("has_tqdm", [True, False])
def test_a_progress_bar_shows_samples(has_tqdm, monkeypatch, capsys):
    if has_tqdm:
        pytest.importorskip("tqdm")
    else:
        monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    with _render.watcher(True) as watch:
        watch(0.25, 4, 1.0)
        watch(1.0, 16, 4.0)
    shown = capsys.readouterr().err
    assert "100" in shown and "16 samples" in shown and shown.endswith("\n"), shown


def test_progress_is_true_or_a_function(box):
    with pytest.raises(taugate.SettingsError, match="must be True or a function"):
        taugate.render(box, progress=3)


def test_a_progress_function_cannot_use_its_scene(box):
    with pytest.raises(taugate.SettingsError, match="being rendered"):
        taugate.render(box, spp=4, progress=lambda step: box.info())
    # Other scenes can be rendered meanwhile.
    other = taugate.load(BOX, resolution=SIZE)
    inner = []
    taugate.render(box, spp=4, progress=lambda step: inner.append(taugate.render(other, spp=2)))
    assert inner


def test_a_slow_progress_function_gets_the_newest_step(box):
    steps = []

    def slow(step):
        steps.append(step.samples)
        time.sleep(0.5)

    taugate.render(box, spp=64, light_paths=100, progress=slow)
    assert len(steps) < 10 and steps[-1] == 64


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
@pytest.mark.filterwarnings("ignore:This process")
def test_a_forked_process_explains_itself(box):
    data = pickle.dumps(taugate.render(box, spp=1))
    work = [lambda: taugate.render(box, spp=1), lambda: taugate.load(BOX), lambda: pickle.loads(data).pixels]
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        for call in work:
            try:
                call()
                text = "did it"
            except taugate.DeviceError as error:
                text = str(error)
            os.write(write, f"{text}\n".encode())
        os._exit(0)
    os.waitpid(child, 0)
    lines = os.read(read, 10000).decode().splitlines()
    assert len(lines) == len(work) and all("get_context('spawn')" in line for line in lines), lines


def test_an_image_does_not_keep_its_scene():
    scene = taugate.load(BOX, resolution=SIZE)
    image, scene = taugate.render(scene, spp=1), weakref.ref(scene)
    gc.collect()
    assert scene() is None and image.pixels.any()


def test_the_mean_is_that_of_the_pixels(box):
    image = taugate.render(box, spp=4)
    mean, error = image.mean
    assert np.isclose(mean, image.pixels.mean(dtype=float), rtol=1e-5) and 0 < error < mean


def test_an_interrupt_keeps_the_image_so_far(box, interrupting):
    started = time.monotonic()
    with pytest.raises(taugate.Interrupted) as stopped:
        taugate.render(box, time=3600, progress=interrupting)
    assert time.monotonic() - started < 1800
    assert isinstance(stopped.value, KeyboardInterrupt)
    image = stopped.value.image
    assert image.samples > 0 and np.isfinite(image.pixels).all() and image.pixels.any()


def test_an_interrupt_keeps_the_image_of_a_response(box, tmp_path, interrupting):
    table = tmp_path / "table.csv"
    table.write_text("tau_m,weight\n4,0\n6,1\n9,0\n")
    # Iterations are long, so the interrupt comes within one.
    with pytest.raises(taugate.Interrupted) as stopped:
        taugate.render(box, response=f"a={table}", time=3600, resolution=(256, 256), progress=interrupting)
    image = stopped.value.image
    assert image.samples > 0 and image.pixels.any()


def test_a_render_goes_on_from_its_checkpoint(box, program, tmp_path):
    path = tmp_path / "x.acc"
    for call, settings in ((taugate.histogram, dict(gates="5m..9m/4")), (taugate.render, dict(gate="6m..7m"))):
        path.unlink(missing_ok=True)
        assert call(box, spp=4, checkpoint=path, every=1, **settings).samples == 4
        more = call(box, spp=8, checkpoint=path, **settings)
        assert any("going on after 4 samples" in note for note in more.notes)
        assert np.array_equal(more.pixels, call(box, spp=8, **settings).pixels) and more.samples == 8
    # The file has 8 samples, also for the program.
    again = taugate.render(box, spp=12, resume=path, gate="6m..7m")
    words = ["--gate", "6m..7m", "--resolution", "32x32", "--resume", "x.acc", "--spp", 12, "-o", "y.npy"]
    code, text = program("render", BOX, *words)
    assert code == 0 and "going on after 8 samples" in text, text
    assert np.array_equal(again.pixels, np.load(tmp_path / "y.npy"))
    for scene, mistake, message in (
        (box, dict(gate="6m..8m", checkpoint=path), "are not the same render: .*6m..8m"),
        (room(), dict(resume=path), "is in no file, so its render cannot be continued"),
        (box, dict(every=5), "add --checkpoint"),
        (box, dict(checkpoint="x.exr"), "must end in .acc"),
    ):
        with pytest.raises(taugate.SettingsError, match=message):
            taugate.render(scene, **mistake)
    assert [name.name for name in tmp_path.glob(".*")] == [], "a lock is left"


@pytest.mark.parametrize("call", ["render(box, gate='5m..6m', spp=10000)", "histogram(box, gates='4m..8m/4', spp=10000)"])
def test_a_lost_device_leaves_the_image_so_far(call, tmp_path):
    code = f"""if True:
        import numpy as np, taugate
        box = taugate.load({str(SCENES / "cornell-box.glb")!r}, resolution=(8, 8), light_paths=100, max_depth=4)
        try:
            taugate.{call}
        except taugate.DeviceError as error:
            assert "was lost" in str(error), error
            lost = error.image
        whole = taugate.{call.replace("10000", "lost.samples")}
        assert np.array_equal(lost.pixels, whole.pixels) and lost.samples > 2, lost
    """
    lost_soon = {**os.environ, "TAUGATE_LOST_AFTER": "150"}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=lost_soon, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_histogram_must_fit_twice_into_the_memory(box):
    try:
        [line] = [line for line in open("/proc/meminfo") if line.startswith("MemAvailable")]
    except OSError:
        pytest.skip("this system does not tell how much memory is free")
    # Three numbers of 8 bytes per pixel and gate.
    count = int(0.7 * 1024 * int(line.split()[1]) / (24 * 1024**2))
    with pytest.raises(taugate.SettingsError, match=f"a histogram of {count} gates of 1024x1024 pixels needs .* use fewer gates"):
        taugate.histogram(box, gates=(4, 9, count), resolution=(1024, 1024), spp=1)


def test_other_threads_run_during_a_render(box):
    count = [0, True]

    def work():
        while count[1]:
            count[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=work)
    thread.start()
    image = taugate.render(box, time=0.5)
    count[1] = False
    thread.join()
    assert image.samples > 2 and count[0] > 50


def test_a_scene_says_what_it_contains(box):
    info = box.info(arrival=True)
    assert info["cameras"] == ["camera"] and info["emitters"] == ["light"] and info["triangles"] == 36
    assert np.allclose(info["bounds"], [[-1, 0, -1], [1, 2, 1]])
    first, _, median, _, last = info["arrival"]
    assert 3 < first < median < last
    assert taugate.render(box, gate=info["suggested_gate"], spp=2).pixels.any()


def test_the_light_of_the_sky_has_no_travel_time(box):
    info = box.info(arrival=True, sky=1000)
    assert np.allclose(info["arrival"], box.info(arrival=True)["arrival"], rtol=0.01)
    info = box.info(arrival=True, sky=1000, emitters="sky")
    assert info["arrival"] is None and info["suggested_gate"] is None


def test_a_continuous_wave_sensor_has_layers_of_depth(box):
    waves = taugate.histogram(box, cw=20, spp=2)
    assert waves.pixels.shape == (32, 32, 4, 3)
    assert any("depth" in name for name in waves.layers), list(waves.layers)


def test_results_are_plotted_in_one_line(box):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    assert taugate.render(box, spp=2).show().images
    assert taugate.histogram(box, gates="5m..9m/8", spp=2).show(pixel=(3, 4)).patches
