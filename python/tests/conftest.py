"""What the tests share."""

import os
import signal
import subprocess
import threading

import numpy as np
import pytest

import taugate
from places import PROGRAM, ROOT, SCENES

SIZE = (32, 32)


def pytest_collection_modifyitems(items):
    """The tests of the page begin first, because they take longest."""
    items.sort(key=lambda item: item.path.parent.name != "view")


@pytest.fixture(autouse=True)
def interrupts():
    """Python ignores Ctrl-C in a background job of a shell. The tests send Ctrl-C, so this restores the handler."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def interrupting():
    """A function for `progress` that sends Ctrl-C soon after its first call. So there is a first image, however busy the machine is."""
    sent = []

    def progress(_):
        if not sent:
            sent.append(threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)))
            sent[0].start()

    return progress


@pytest.fixture(scope="session")
def box():
    return taugate.load(SCENES / "cornell-box.glb", resolution=SIZE)


@pytest.fixture
def program(tmp_path):
    """Runs the program in a new folder, and returns its exit code and stderr."""
    if not PROGRAM.exists():
        pytest.skip("the program is not built: cargo build --release")

    def run(*words):
        done = subprocess.run([PROGRAM, *map(str, words)], cwd=tmp_path, capture_output=True, text=True)
        return done.returncode, done.stderr

    return run


def quad(x=(0, 0, 0), right=(1, 0, 0), up=(0, 1, 0)):
    """Vertices and triangles of a parallelogram around x; its front faces cross(right, up)."""
    x, right, up = (np.array(v, float) for v in (x, right, up))
    vertices = [x - right - up, x + right - up, x + right + up, x - right + up]
    return np.array(vertices), np.array([[0, 1, 2], [0, 2, 3]])


def room(**settings):
    """A floor, a wall, a lamp and a camera, from arrays."""
    scene = taugate.Scene(resolution=SIZE, **settings)
    scene.add_mesh("floor", *quad((0, 0, 0), (2, 0, 0), (0, 0, -2)), taugate.Material.diffuse(0.6))
    scene.add_mesh("wall", *quad((0, 2, -2), (2, 0, 0), (0, 2, 0)), taugate.Material.diffuse((0.7, 0.5, 0.3)))
    scene.add_mesh("board", *quad((0, 0, 0), (0.4, 0, 0), (0, 0.4, 0)), transform=shift(0, 0.5, -1), moves=True)
    scene.add_light("point", "lamp", (0.5, 2.5, 0.5), intensity=10.0)
    scene.add_camera("front", taugate.Camera.look_at((0, 1.2, 4), (0, 0.8, 0), fov=40, resolution=SIZE))
    return scene


def add_speck(scene):
    """Adds a speck, which no camera of the tests sees. Its material has all features of textures, so that scenes with it share compiled
    kernels."""
    texels = np.full((2, 2, 4), 255, np.uint8)
    texels[0, 0, 3] = 0
    turn = np.diag([2.0, 1.0, 1.0])
    numbers = taugate.Texture(np.full((2, 2), 0.5), transform=turn)
    material = taugate.Material(
        texture=taugate.Texture(texels, transform=turn), roughness_texture=numbers, metallic_texture=numbers, metallic=1.0
    )
    scene.add_mesh("speck", *quad((3, 0, 0), (0.01, 0, 0), (0, 0.01, 0)), material, uvs=[(0, 0), (1, 0), (1, 1), (0, 1)])
    return scene


def shift(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def agree(a, b, limit=4.5):
    """Whether two images are the same within their errors: the z score of their means."""
    difference = a.pixels.mean(dtype=float) - b.pixels.mean(dtype=float)
    spread = np.hypot(*(np.sqrt(image.variance.astype(float)).mean() for image in (a, b)))
    return abs(difference) < limit * spread
