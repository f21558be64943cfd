"""Scenes from arrays, nodes that move, materials, and pickles."""

import copy
import pickle
import threading
import time

import numpy as np
import pytest

import taugate
from conftest import ROOT, SCENES, SIZE, add_speck, agree, quad, room, shift


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


def test_copies_of_a_node_keep_their_places_relative_to_each_other():
    scene = taugate.load(ROOT / "tests/data/gltf/gpu_instances.glb", resolution=SIZE)
    bounds = lambda: np.array(scene.info()["bounds"])
    before, there, ends = bounds(), scene.transform("rows"), []
    for side in (0, 1):
        scene.set_transform("rows", shift(20 * side - 10, 2, 0) @ there)
        assert np.allclose(scene.transform("rows"), shift(20 * side - 10, 2, 0) @ there)
        ends.append(bounds()[side, 0] - (20 * side - 10))
    # A cube is 0.3 m wide; the first one is at x = -1.
    assert np.isclose(ends[0], -1.15) and ends[1] > 1
    scene.set_transform("rows", there)
    assert np.allclose(bounds(), before)


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


def test_a_copy_has_its_own_objects():
    scene = room()
    twin = copy.copy(scene)
    twin.remove("board")
    twin.remove("front")
    twin.settings = {**twin.settings, "spp": 1}
    assert "board" in scene._meshes and "front" in scene.cameras and "spp" not in scene.settings
    assert taugate.render(scene, camera=scene.cameras["front"], spp=1).samples == 1


def test_changes_after_adding_count_or_are_refused():
    scene, paint = room(spp=2), taugate.Material.diffuse(texture=taugate.Texture(np.ones((1, 1))))
    scene.add_material("paint", paint)
    assert taugate.render(scene).samples == 2
    for thing, field in ((paint, "color"), (paint.texture, "filter")):
        with pytest.raises(taugate.SettingsError, match=f"does not change; make another one with dataclasses.replace\\(old, {field}=...\\)"):
            setattr(thing, field, 1)
    with pytest.raises(TypeError, match="item assignment"):
        scene.settings["spp"] = 3
    scene.settings = {**scene.settings, "spp": 3}
    assert taugate.render(scene).samples == 3
    file = taugate.load(SCENES / "cornell-box.glb", resolution=SIZE, spp=2)
    file.set_transform("tall box", shift(0.1, 0, 0) @ file.transform("tall box"))
    moved = taugate.render(file).pixels
    file.settings = {**file.settings, "seed": 1}
    file.settings = {**file.settings, "seed": 0}
    assert np.array_equal(taugate.render(file).pixels, moved)
    with pytest.raises(TypeError, match="did you mean spp"):
        scene.settings = dict(sp=3)


def test_changes_of_the_callers_texels_do_not_count():
    texels, scene = np.full((4, 4, 3), 0.8), room(spp=1)
    paint = taugate.Material.diffuse(texture=taugate.Texture(texels, filter="nearest"))
    scene.add_material("paint", paint)
    scene.add_material("same", taugate.Material.diffuse(texture=texels))
    texels[:] = 0
    assert (scene._materials["paint"].texture.texels == 0.8).all()
    assert scene._materials["paint"].texture.texels is scene._materials["same"].texture
    for twin in (pickle.loads(pickle.dumps(scene)), copy.copy(scene), copy.deepcopy(scene)):
        assert twin._materials["paint"].texture.texels is twin._materials["same"].texture


def test_threads_may_use_a_new_scene():
    scene, made = room(spp=1), []
    build = scene._from_arrays

    def slow():
        made.append(0)
        time.sleep(0.2)
        return build()

    scene._from_arrays = slow
    threads = [threading.Thread(target=scene.info) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 1


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
    scene = add_speck(room())
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    material = taugate.Material.diffuse(1.0, texture=texture)
    scene.add_mesh("board", *quad((0, 0, 0), (0.8, 0, 0), (0, 0.8, 0)), material, transform=shift(0, 1, 0), uvs=uvs)
    albedo = taugate.render(scene, spp=1, aov="albedo").albedo
    assert albedo[12, 12].mean() > 3 * albedo[12, 20].mean()
    for material in (taugate.Material.metal(), taugate.Material.plastic(), taugate.Material.emitter(2)):
        scene.add_mesh("board", *quad(), material)
        assert taugate.render(scene, spp=1).pixels.any()


def test_a_mesh_keeps_a_material_of_its_name():
    scene = room()
    scene.add_material("wall", taugate.Material.diffuse((0, 0, 1)))
    scene.add_material("paint", taugate.Material.diffuse((0, 1, 0)))
    scene.add_mesh("paint", *quad((0, 1, 1), (1, 0, 0), (0, 1, 0)), "paint")
    # The own material of a mesh neither replaces a material of this name nor is replaced by it.
    scene.add_mesh("wall", *quad((9, 9, 9)), taugate.Material.diffuse((1, 0, 0)))
    scene.add_mesh("board", *quad((0, 1, 2), (0.5, 0, 0), (0, 0.5, 0)), "wall")
    scene.add_material("board", taugate.Material.diffuse((1, 1, 1)))
    image = taugate.render(scene, spp=4, aov="albedo,object")
    number = {name: key for key, name in image.objects.items()}
    for name, color in (("board", (0, 0, 1)), ("paint", (0, 1, 0)), ("floor", (0.6, 0.6, 0.6))):
        assert np.allclose(np.median(image.albedo[image.object == number[name]], axis=0), color, atol=0.01), name
    # A new own material replaces the old one.
    scene.add_mesh("floor", *quad((0, 0, 0), (2, 0, 0), (0, 0, -2)))
    assert np.allclose(np.median(taugate.render(scene, spp=4, aov="albedo").albedo[image.object == number["floor"]], axis=0), 0.5, atol=0.01)


def wall_albedo(texture, **material):
    """The albedo (24, 24, 3) of a square whose left bottom corner has the texture coordinates (0, 1) and whose right top corner has (1, 0)."""
    scene = taugate.Scene(resolution=(24, 24))
    uvs = np.array([[0, 1], [1, 1], [1, 0], [0, 0]])
    scene.add_mesh("wall", *quad(), taugate.Material.diffuse(1.0, texture=texture, **material), uvs=uvs)
    add_speck(scene)
    scene.add_light("point", "lamp", (0, 0, 3), intensity=10.0)
    scene.add_camera("front", taugate.Camera.look_at((0, 0, 100), (0, 0, 0), fov=np.degrees(2 * np.arctan(0.01)), resolution=(24, 24)))
    return taugate.render(scene, spp=64, aov="albedo").albedo


def test_textures_have_filters_wrap_modes_and_transforms():
    # Values that have sRGB bytes.
    bytes = np.array([[[0, 64, 255], [255, 64, 0]], [[128, 128, 128], [200, 0, 64]], [[9, 8, 7], [100, 200, 30]]], np.uint8)
    linear = np.where(bytes / 255 < 0.04045, bytes / 255 / 12.92, ((bytes / 255 + 0.055) / 1.055) ** 2.4)
    large = np.kron(linear, np.ones((8, 12, 1)))
    for texels in (bytes, linear, linear.astype(np.float32), np.dstack([linear, np.ones((3, 2))])):
        albedo = wall_albedo(taugate.Texture(texels, filter="nearest"))
        assert np.allclose(albedo, large, atol=2e-3)
    twice = np.diag([2.0, 1.0, 1.0])
    halves = {"repeat": (1, 1), "mirror": (1, -1), "clamp": (1, 0)}
    for wrap, (_, second) in halves.items():
        albedo = wall_albedo(taugate.Texture(bytes, wrap=wrap, filter="nearest", transform=twice))
        left = large[:, ::2]
        right = {1: left, -1: left[:, ::-1], 0: np.repeat(left[:, -1:], 12, axis=1)}[second]
        assert np.allclose(albedo, np.hstack([left, right]), atol=2e-3), wrap
    pair = wall_albedo(taugate.Texture(bytes, wrap=("mirror", "clamp"), filter="nearest", transform=twice))
    assert np.allclose(pair[:, 12:], pair[:, 11::-1], atol=2e-3)
    # One channel is grey, in linear floats and in sRGB bytes.
    assert np.allclose(wall_albedo(np.full((2, 2), 0.25)), 0.25, atol=3e-3)
    assert np.allclose(wall_albedo(np.full((1, 1, 1), 137, np.uint8)), 0.25, atol=3e-3)
    # Where alpha is 0, there is no wall.
    holes = np.full((1, 2, 4), 255, np.uint8)
    holes[0, 0, 3] = 0
    albedo = wall_albedo(taugate.Texture(holes, filter="nearest"))
    assert not albedo[:, :12].any() and np.allclose(albedo[:, 12:], 1)
    # Bilinear: the middle between black and white.
    assert np.allclose(wall_albedo(np.array([[0.0, 1.0]]))[:, 11:13].mean(), 0.5, atol=0.01)


def test_textures_of_roughness_change_the_image():
    def pixels(spp=16, **material):
        scene = add_speck(room())
        uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        scene.add_mesh("floor", *quad((0, 0, 0), (2, 0, 0), (0, 0, -2)), taugate.Material.metal(0.8, **material), uvs=uvs)
        return taugate.render(scene, spp=spp).pixels.reshape(8, 4, 8, 4, 3).mean(axis=(1, 3))

    uniform = pixels(roughness=0.2)
    difference = lambda other: np.abs(other - uniform).mean() / uniform.mean()
    # With the same random numbers, the images differ by the rounding of the roughness.
    for texels in (np.full((3, 2), 0.2), np.full((1, 1), 51, np.uint8)):
        assert difference(pixels(roughness=1.0, roughness_texture=texels)) < 0.02
    assert difference(pixels(roughness=1.0, roughness_texture=np.full((1, 1), 0.3))) > 0.03
    # Textures of one material may have different transforms. Here one shows the right edge of its image, and one the left edge.
    texels = np.array([[1.0, 1.0, 0.2, 0.2]])
    right, left = (taugate.Texture(texels, "clamp", transform=[[1, 0, x], [0, 1, 0], [0, 0, 1]]) for x in (1, -1))
    uniform = pixels(512, roughness=0.2)
    assert difference(pixels(512, roughness=1.0, roughness_texture=right, texture=left)) < 0.05
    assert difference(pixels(512, roughness=1.0, roughness_texture=left, texture=left)) > 0.1


def test_textures_of_metalness_change_the_image():
    def pixels(**material):
        scene = add_speck(room())
        uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        scene.add_mesh("floor", *quad((0, 0, 0), (2, 0, 0), (0, 0, -2)), taugate.Material(color=(0.8, 0.4, 0.2), **material), uvs=uvs)
        return taugate.render(scene, spp=16).pixels.reshape(8, 4, 8, 4, 3).mean(axis=(1, 3))

    uniform = pixels(metallic=0.5, roughness=0.4)
    difference = lambda other: np.abs(other - uniform).mean() / uniform.mean()
    half, other = np.full((3, 2), 0.5), np.full((3, 2), 0.4)
    # With the same random numbers, the images differ by the rounding of the textures. The factors multiply.
    assert difference(pixels(metallic=1.0, metallic_texture=half, roughness=0.4)) < 0.02
    assert difference(pixels(metallic=1.0, metallic_texture=half, roughness=1.0, roughness_texture=other)) < 0.02
    assert difference(pixels(metallic=1.0, metallic_texture=other, roughness=1.0, roughness_texture=half)) > 0.03
    assert difference(pixels(metallic=0.5, metallic_texture=half, roughness=0.4)) > 0.03


def test_mistakes_in_textures_are_explained():
    for texels, message in (
        (np.zeros((2, 2, 2)), r"texture of 'wall' has the shape \(2, 2, 2\), but must be \(H, W\), \(H, W, 1\), \(H, W, 3\) or \(H, W, 4\)"),
        (np.zeros(3), "shape"),
        (np.zeros((0, 2, 3)), "from 1 to 16,384 texels"),
        (np.zeros((20000, 1, 3), np.uint8), "from 1 to 16,384 texels"),
        (np.zeros((2, 2, 3), np.uint16), "uint16"),
        (np.full((2, 2, 3), np.nan), "from 0 to 1"),
        (np.full((2, 2, 3), 1.5), "from 0 to 1"),
        (taugate.Texture(np.zeros((2, 2)), wrap="tile"), "repeat, mirror or clamp"),
        (taugate.Texture(np.zeros((2, 2)), wrap=("repeat",)), "repeat, mirror or clamp"),
        (taugate.Texture(np.zeros((2, 2)), filter="cubic"), "linear or nearest"),
        (taugate.Texture(np.zeros((2, 2)), transform=np.eye(2)), "3 x 3"),
        (taugate.Texture(np.zeros((2, 2)), transform=np.diag([1e9, 1, 1])), "1e6"),
    ):
        with pytest.raises(taugate.SettingsError, match=message):
            wall_albedo(texels)
    with pytest.raises(taugate.SettingsError, match="roughness_texture of 'wall' has the shape"):
        wall_albedo(None, roughness_texture=np.zeros((2, 2, 3)))
    with pytest.raises(taugate.SettingsError, match="metallic_texture of 'wall' has the shape"):
        wall_albedo(None, metallic_texture=np.zeros((2, 2, 3)))
    with pytest.raises(taugate.SettingsError, match="roughness_texture and the metallic_texture of 'wall' .* same shape"):
        wall_albedo(None, roughness_texture=np.zeros((2, 2)), metallic_texture=np.zeros((2, 3)))
    with pytest.raises(taugate.SettingsError, match="roughness_texture and the metallic_texture of 'wall' .* same wrap, filter and transform"):
        wall_albedo(None, roughness_texture=np.zeros((2, 2)), metallic_texture=taugate.Texture(np.zeros((2, 2)), "clamp"))
    scene = room()
    scene.add_mesh("x", *quad(), taugate.Material(texture=np.zeros((2, 2))))
    with pytest.raises(taugate.SettingsError, match="mesh 'x' has a texture, so the mesh needs uvs"):
        taugate.render(scene)
    scene.add_mesh("x", *quad(), uvs=np.zeros((4, 3)))
    with pytest.raises(taugate.SettingsError, match="last axis must be 2"):
        taugate.render(scene)


def test_small_meshes_far_from_the_origin_keep_their_shape():
    """UTM coordinates have steps of half a metre as 32-bit numbers."""
    far = np.array([4.5e5, 5.4e6, 120.3])
    vertices = np.array([(0, 0, 0), (3.3, 0, 0), (3.3, 2.1, 0), (0, 2.1, 0.7)]) + far
    triangles = [(0, 1, 2), (0, 2, 3)]
    scene = taugate.Scene(headlamp=1, look_from=tuple(far + 5), look_at=tuple(far))
    scene.add_mesh("tile", vertices, triangles)
    low, high = np.array(scene.info()["bounds"])
    assert np.allclose(high - low, (3.3, 2.1, 0.7), atol=1e-6) and np.allclose(low, far, atol=1e-6)
    assert (scene.transform("tile") == np.eye(4)).all()
    # A transform applies to the vertices that were given.
    turn = np.array([(0, -1, 0, 5.4e6), (1, 0, 0, -4.5e5), (0, 0, 1, 0), (0, 0, 0, 1.0)])
    scene.set_transform("tile", turn)
    low, high = np.array(scene.info()["bounds"])
    assert np.allclose([low, high], [(-2.1, 0, 120.3), (0, 3.3, 121)], atol=1e-6)
    # Ordinary vertices are used as they are.
    scene.add_mesh("tile", vertices - far, triangles)
    assert not scene._meshes["tile"]["centre"].any()


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


def test_media_are_those_of_the_settings():
    smoke = np.random.default_rng(4).random((3, 4, 5))
    low, high = (-1, 0, -1), (1, 1.5, 0.5)
    with_settings = dict(sigma_s=0.4, sigma_a=(0.1, 0.2, 0.3), phase="hg", phase_g=0.5, medium_bounds=(*low, *high))
    medium = dict(sigma_s=0.4, sigma_a=(0.1, 0.2, 0.3), phase={"type": "hg", "g": 0.5}, bounds=(low, high))
    for density in (None, smoke):
        scene = room()
        scene.add_medium("smoke", **medium, density=density)
        same = taugate.render(room(), spp=2, **with_settings, **({} if density is None else {"density_grid": density}))
        assert np.array_equal(taugate.render(pickle.loads(pickle.dumps(scene)), spp=2).pixels, same.pixels)
        assert not np.array_equal(taugate.render(scene, spp=2, no_medium=True).pixels, same.pixels)
    # The transform of a grid.
    scene.add_medium("smoke", **{**medium, "bounds": ((0, 0, 0), (1, 1, 1))}, density=smoke, transform=shift(0, 0.3, 0) * 1.0, filter="nearest")
    rows = (1, 0, 0, 0, 0, 1, 0, 0.3, 0, 0, 1, 0)
    with_settings.update(density_grid=smoke, grid_filter="nearest", grid_transform=rows, medium_bounds=(0, 0, 0, 1, 1, 1))
    assert np.array_equal(taugate.render(scene, spp=2).pixels, taugate.render(room(), spp=2, **with_settings).pixels)
    scene.remove("smoke")
    assert np.array_equal(taugate.render(scene, spp=2).pixels, taugate.render(room(), spp=2).pixels)
    # The last medium counts.
    scene.add_medium("thick", sigma_a=5)
    scene.add_medium("clear")
    assert np.allclose(taugate.render(scene, spp=2).pixels.mean(), taugate.render(room(), spp=2).pixels.mean(), rtol=0.02)


def test_a_mesh_may_bound_a_medium():
    def cloud(sigma_a):
        scene = room()
        cube, faces = [], []
        for axis in range(3):
            for sign in (-1, 1):
                normal, right = sign * np.eye(3)[axis], np.eye(3)[(axis + 1) % 3]
                vertices, triangles = quad(normal, right, np.cross(normal, right))
                faces.append(triangles + 4 * len(cube))
                cube.append(vertices)
        material = taugate.Material.glass(1.0, interior={"sigma_a": np.array(sigma_a)})
        scene.add_mesh("cloud", 0.5 * np.concatenate(cube), np.concatenate(faces), material, transform=shift(0, 1, 0.5))
        return taugate.render(scene, spp=16).pixels.mean()

    box = room()
    box.add_medium("cloud", sigma_a=2, bounds=((-0.5, 0.5, 0), (0.5, 1.5, 1)))
    mean = taugate.render(box, spp=16).pixels.mean()
    assert cloud([2, 2, 2]) == pytest.approx(mean, rel=0.03) and cloud([0.5, 0.5, 0.5]) > 1.1 * mean


def test_a_sky_may_be_an_array():
    scene = taugate.Scene(resolution=SIZE, sky=np.array([0.5, 1, 2]))
    scene.add_mesh("floor", *quad((0, 0, 0), (2, 0, 0), (0, 0, -2)), taugate.Material.diffuse(0.6))
    scene.add_camera("front", taugate.Camera.look_at((0, 1.2, 4), (0, 0.8, 0), fov=40, resolution=SIZE))
    constant = taugate.render(scene, spp=4).pixels
    assert np.allclose(constant[0, 0], (0.5, 1, 2))
    same = taugate.render(scene, sky=np.full((2, 4, 3), (0.5, 1, 2)), spp=4).pixels
    assert np.allclose(same.mean(axis=(0, 1)), constant.mean(axis=(0, 1)), rtol=0.03)
    # The camera looks along -Z, at a quarter of the width.
    image = np.zeros((1, 4, 3))
    image[:, :2] = 1, 2, 3
    assert np.allclose(taugate.render(scene, sky=image, spp=4).pixels[0, 16], (1, 2, 3))


def test_mistakes_in_media_are_explained():
    scene = room()
    for wrong, message in (
        ({"sigma_s": -1}, "the medium 'x' has a sigma_s of -1; it must be from 0"),
        ({"sigma_s": (1, 2)}, "neither one number nor three"),
        ({"phase": {"type": "hg", "g": 3}}, "a g of 3; it must be from"),
        ({"phase": {"type": "cloud"}}, "cannot be read"),
        ({"density": np.ones((2, 2, 2))}, "the medium 'x' has a density, but no bounds"),
        ({"density": np.ones((2, 2))}, "must have 3 axes"),
        ({"transform": np.eye(4)}, "has a transform, but no density"),
        ({"filter": "cubic"}, "choose linear or nearest"),
    ):
        with pytest.raises(taugate.SettingsError, match=message):
            scene.add_medium("x", **wrong)
            scene.info()
        scene = room()
    scene.add_material("glass", taugate.Material.glass(interior={"sigma_t": 1}))
    with pytest.raises(taugate.SettingsError, match="the interior of 'glass' has no sigma_t; choose from"):
        scene.info()
    with pytest.raises(taugate.SettingsError, match="must be a radiance, or numbers"):
        taugate.render(room(), sky=np.ones((2, 3)))
    with pytest.raises(taugate.SettingsError, match="this scene was read from a file"):
        taugate.load(SCENES / "cornell-box.glb").add_medium("x", sigma_s=1)


def test_a_scene_from_arrays_may_be_a_scan():
    scene = taugate.Scene(gates=(3, 7, 40))
    scene.add_mesh("wall", *quad((0, 0, 0), (2, 0, 0), (0, 2, 0)), taugate.Material.diffuse(0.7))
    scene.add_mesh("board", *quad((0, 0, 2), (-0.4, 0, 0), (0, 0.4, 0)), taugate.Material.diffuse(0.7))
    scene.scan = {"laser": np.array([1.5, 0, 1]), "points": [[0.5, 0, 0], [0, 0.5, 0]]}
    found = taugate.scan(scene, spp=16)
    assert found.data.shape == (40, 2) and found.data.any()
    assert np.array_equal(taugate.scan(pickle.loads(pickle.dumps(scene)), spp=16).data, found.data)
    with pytest.raises(taugate.SettingsError, match="measure it with taugate.scan"):
        taugate.render(scene, spp=1)
    scene.scan = {"laser": [1.5, 0, 1]}
    with pytest.raises(taugate.SettingsError, match="needs points"):
        taugate.scan(scene, spp=1)
    scene.scan = None
    with pytest.raises(taugate.SettingsError, match="this is no scan"):
        taugate.scan(scene, spp=1)
