"""Scenes from arrays, nodes that move, materials, and pickles."""

import copy
import pickle

import numpy as np
import pytest

import taugate
from conftest import SCENES, SIZE, agree, quad, room, shift


def test_a_lit_floor_has_the_radiance_of_the_formula():
    scene = taugate.Scene(resolution=(1, 1), max_depth=2)
    scene.add_mesh("floor", *quad((0, 0, 0), (50, 0, 0), (0, 0, -50)), taugate.Material.diffuse(0.5))
    scene.add_light("point", "lamp", (0, 2, 0), intensity=8.0)
    scene.add_camera("down", taugate.Camera.look_at((0, 3, 0), (0, 0, 0), up=(0, 0, -1), fov=0.1, resolution=(1, 1)))
    # albedo / pi * intensity / distance^2; the path is 2 m + 3 m long.
    truth = 0.5 / np.pi * 8 / 4
    image = taugate.render(scene, gate="4.9m..5.1m", spp=8)
    assert np.allclose(image.pixels, truth, rtol=1e-3)
    assert not np.allclose(image.pixels, 1.02 * truth, rtol=1e-3)
    assert np.allclose(taugate.render(scene, spp=8).pixels, truth, rtol=1e-3)
    with pytest.raises(taugate.SettingsError, match="meets no light"):
        taugate.render(scene, gate="7m..8m")


def test_moved_instances_have_the_bits_of_a_new_scene():
    scene = room()
    before = taugate.render(scene, spp=2)
    scene.set_transform("board", shift(0.5, 0.7, -0.5))
    moved = taugate.render(scene, spp=2)
    fresh = room()
    fresh.set_transform("board", shift(0.5, 0.7, -0.5))
    assert np.array_equal(moved.pixels, taugate.render(fresh, spp=2).pixels)
    assert not np.array_equal(moved.pixels, before.pixels)
    scene.set_transform("board", shift(0, 0.5, -1))
    assert np.array_equal(taugate.render(scene, spp=2).pixels, before.pixels)
    # An instance without moves=True can move too.
    scene.set_transform("wall", shift(0, 0, -0.5))
    assert taugate.render(scene, spp=2, aov="depth").depth.max() > before.camera.world_from_camera[2, 3] + 2


def test_nodes_of_a_file_move():
    scene, twin = (taugate.load(SCENES / "cornell-box.glb", resolution=SIZE, moves="tall box") for _ in range(2))
    there = scene.transform("tall box")
    before = taugate.render(scene, spp=2)
    scene.set_transform("tall box", shift(0.1, 0, 0.2) @ there)
    twin.set_transform("tall box", shift(0.1, 0, 0.2) @ there)
    moved = taugate.render(scene, spp=2)
    assert not np.array_equal(moved.pixels, before.pixels)
    assert np.array_equal(moved.pixels, taugate.render(twin, spp=2).pixels)
    scene.set_transform("tall box", there)
    assert np.array_equal(taugate.render(scene, spp=2).pixels, before.pixels)
    with pytest.raises(taugate.SettingsError, match="no node 'chair'"):
        scene.set_transform("chair", there)
    with pytest.raises(taugate.SettingsError, match="no node 'chair', so it cannot move"):
        taugate.load(SCENES / "cornell-box.glb", moves=["chair"])


def test_scenes_survive_pickle_and_copy():
    scene = room()
    scene.set_transform("board", shift(0.5, 0.7, -0.5))
    image = taugate.render(scene, spp=2)
    for twin in (pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene)):
        assert np.array_equal(taugate.render(twin, spp=2).pixels, image.pixels)
    file = taugate.load(SCENES / "cornell-box.glb", resolution=SIZE)
    file.set_transform("tall box", shift(0.1, 0, 0) @ file.transform("tall box"))
    twin = pickle.loads(pickle.dumps(file))
    assert np.array_equal(taugate.render(twin, spp=2).pixels, taugate.render(file, spp=2).pixels)


def test_fog_and_lights_are_settings():
    clear, fog = taugate.render(room(), spp=4), taugate.render(room(sigma_a=0.1, sigma_s=0.01, phase="hg", phase_g=0.5), spp=4)
    assert clear.pixels.mean() > fog.pixels.mean() > 0
    scene = room()
    scene.add_light("spot", "torch", (0, 2, 3), intensity=(20, 0, 0), target=(0, 0, 0), outer_angle=20)
    assert scene.info()["emitters"] == ["lamp", "torch"]
    assert taugate.render(scene, spp=4).pixels[..., 0].mean() > clear.pixels[..., 0].mean()
    scene.remove("torch")
    assert np.array_equal(taugate.render(scene, spp=4).pixels, clear.pixels)


def test_materials_and_textures():
    texture = np.zeros((2, 2, 3), np.uint8)
    texture[:, 0] = 255
    scene = room()
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    material = taugate.Material.diffuse(1.0, texture=texture)
    scene.add_mesh("board", *quad((0, 0, 0), (0.8, 0, 0), (0, 0.8, 0)), material, transform=shift(0, 1, 0), uvs=uvs)
    albedo = taugate.render(scene, spp=1, aov="albedo").albedo
    assert albedo[12, 12].mean() > 3 * albedo[12, 20].mean()
    for material in (taugate.Material.metal(), taugate.Material.plastic(), taugate.Material.emitter(2)):
        scene.add_mesh("board", *quad(), material)
        assert taugate.render(scene, spp=1).pixels.any()


def test_mistakes_in_arrays_are_explained():
    scene = room()
    with pytest.raises(taugate.SettingsError, match="vertices have the shape"):
        scene.add_mesh("x", [0, 1, 2], [[0, 1, 2]])
    with pytest.raises(taugate.SettingsError, match="whole numbers"):
        scene.add_mesh("x", np.zeros((3, 3)), [[0, 1, -2]])
    with pytest.raises(taugate.SettingsError, match="no material 'gold'"):
        scene.add_mesh("x", *quad(), "gold")
    with pytest.raises(taugate.SettingsError, match="4 x 4"):
        scene.set_transform("board", np.eye(3))
    with pytest.raises(taugate.SettingsError, match="no instance 'chair'"):
        scene.set_transform("chair", np.eye(4))
    scene.add_mesh("x", np.zeros((3, 2)), [[0, 1, 2]])
    with pytest.raises(taugate.SettingsError, match="last axis must be 3"):
        taugate.render(scene)
    scene.add_mesh("x", quad()[0], [[0, 1, 9]])
    with pytest.raises(taugate.SceneError, match="corner 9"):
        taugate.render(scene)
    scene.add_mesh("x", *quad(), taugate.Material(roughness=2))
    with pytest.raises(taugate.SceneError, match="roughness of 2"):
        taugate.render(scene)
    scene.remove("x")
    with pytest.raises(taugate.SettingsError, match="read from a file"):
        taugate.load(SCENES / "cornell-box.glb").add_mesh("x", *quad())
    with pytest.raises(taugate.SettingsError, match="intensity"):
        scene.add_light("point", "bad", (0, 0, 0))
        taugate.render(scene)
    with pytest.raises(taugate.SceneError, match="no surfaces"):
        taugate.render(taugate.Scene())


def test_triangles_without_area_do_no_harm():
    scene, twin = room(), room()
    vertices, triangles = quad()
    twin.add_mesh("board", *quad((0, 0, 0), (0.4, 0, 0), (0, 0.4, 0)), transform=shift(0, 0.5, -1), moves=True)
    degenerate = np.vstack([twin._meshes["board"]["triangles"], [[0, 0, 1]]])
    twin.add_mesh("board", twin._meshes["board"]["vertices"], degenerate, transform=shift(0, 0.5, -1), moves=True)
    assert agree(taugate.render(scene, spp=4), taugate.render(twin, spp=4))
