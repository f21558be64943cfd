"""Cameras as matrices, and the layers beside an image."""

import numpy as np
import pytest

import taugate
from conftest import SIZE, room


def test_points_of_the_depth_layer_lie_on_the_surfaces():
    scene = room()
    image = taugate.render(scene, spp=1, aov="all")
    points = image.camera.points(image.depth)
    names = image.objects
    assert set(names.values()) == {"floor", "wall", "board"} and scene.info()["objects"] == {1: "floor", 2: "wall", 3: "board"}
    number = {name: key for key, name in names.items()}
    for name, axis, value in (("floor", 1, 0), ("wall", 2, -2), ("board", 2, -1)):
        seen = points[image.object == number[name]]
        assert len(seen) > 5 and np.allclose(seen[:, axis], value, atol=1e-3), name
        assert np.allclose(np.abs(image.normal[image.object == number[name]][:, axis]), 1, atol=1e-5)
    # Counterexample: OpenCV's pixel centres, which are half a pixel away, move the points off the floor.
    K = image.camera.K - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    shifted = taugate.Camera.from_matrices(K, image.camera.world_from_camera, SIZE)
    assert np.abs(shifted.points(image.depth)[image.object == number["floor"]][:, 1]).max() > 0.01
    assert (image.arrival[image.object > 0] > 0).all() and image.albedo.shape == (32, 32, 3)


def test_matrices_describe_the_camera_that_renders():
    scene = room()
    camera = scene.camera()
    assert camera.resolution == SIZE and np.allclose(camera.world_from_camera[:3, 3], (0, 1.2, 4))
    again = taugate.Camera.from_matrices(camera.K, camera.world_from_camera, SIZE)
    of_gl = taugate.Camera.from_matrices(camera.K, camera.world_from_camera_gl, SIZE, axes="opengl")
    image = taugate.render(scene, spp=2, aov="depth")
    for twin in (again, of_gl):
        assert np.allclose(twin.K, camera.K) and np.allclose(twin.world_from_camera, camera.world_from_camera)
        assert np.allclose(taugate.render(scene, camera=twin, spp=2, aov="depth").depth, image.depth, atol=1e-4)
    pixels, z = camera.project(camera.points(image.depth))
    u, v = np.meshgrid(np.arange(32) + 0.5, np.arange(32) + 0.5)
    seen = image.depth > 0
    assert np.allclose(pixels[seen], np.stack([u, v], axis=-1)[seen]) and (z[seen] > 0).all()


def test_an_off_centre_camera_and_a_crop_keep_their_pixels():
    scene = room()
    K = np.array([[40.0, 0, 10], [0, 40, 20], [0, 0, 1]])
    camera = taugate.Camera.from_matrices(K, scene.camera().world_from_camera, (48, 32))
    image = taugate.render(scene, camera=camera, spp=1, aov="depth")
    assert image.pixels.shape == (32, 48, 3) and np.allclose(image.camera.K, K)
    part = taugate.render(scene, camera=camera, spp=1, aov="depth", crop=(5, 30, 10, 20))
    assert part.pixels.shape == (10, 25, 3)
    assert np.array_equal(part.depth, image.depth[10:20, 5:30])
    assert np.allclose(part.camera.points(part.depth), image.camera.points(image.depth)[10:20, 5:30])


@pytest.mark.parametrize(
    "fisheye, distortion", [(False, ()), (False, (-0.28, 0.09, 1.2e-3, -8e-4, -0.012, 0.02, -0.01, 1e-3)), (True, (0.03, -0.012, 0.004, -7e-4))]
)
def test_a_calibrated_lens_has_the_pixels_of_its_model(fisheye, distortion):
    scene = room()
    K = np.array([[30.0, 0, 22.5], [0, 33.0, 15.0], [0, 0, 1]])
    pose = scene.camera().world_from_camera
    camera = taugate.Camera.from_matrices(K, pose, (48, 32), distortion=distortion, fisheye=fisheye)
    image = taugate.render(scene, camera=camera, spp=1, aov="depth")
    assert np.allclose(image.camera.K, K) and image.camera.distortion == distortion and image.camera.fisheye is fisheye
    seen = image.depth > 0
    assert seen.any()
    points = image.camera.points(image.depth)
    # The floor is at y = 0: a ray of another lens would meet it elsewhere.
    floor = seen & (np.abs(points[..., 1]) < 0.02)
    assert floor.sum() > 50 and np.abs(points[floor][:, 1]).max() < 2e-3
    pixels, z = image.camera.project(points)
    u, v = np.meshgrid(np.arange(48) + 0.5, np.arange(32) + 0.5)
    assert np.allclose(pixels[seen], np.stack([u, v], axis=-1)[seen], atol=1e-6)
    if distortion:
        straight = taugate.Camera.from_matrices(K, pose, (48, 32))
        assert np.abs(straight.points(image.depth)[floor][:, 1]).max() > 0.02


@pytest.mark.parametrize("vignetting", ["cos4", [[0, 1], [10, 0.9], [60, 0.1]]])
def test_a_camera_keeps_its_vignetting(vignetting):
    scene = room()
    camera = scene.camera(vignetting=vignetting)
    settings = dict(spp=4, sampling="uniform", gate="0m..inf", estimator="pt")
    image = taugate.render(scene, camera=camera, **settings)
    without = taugate.render(scene, **settings)
    view = camera.world_from_camera[:3, 2]
    angle = np.degrees(np.arccos(without.camera.rays() @ view))
    share = np.cos(np.radians(angle)) ** 4 if vignetting == "cos4" else np.interp(angle, *np.transpose(vignetting))
    assert share.min() < 0.8 and np.allclose(image.pixels.mean(axis=2), share * without.pixels.mean(axis=2), rtol=0.02)
    assert np.allclose(image.camera._settings()["vignetting"], vignetting) if vignetting != "cos4" else image.camera.vignetting == "cos4"
    with pytest.raises(taugate.SettingsError, match="vignetting has the shape"):
        taugate.render(scene, vignetting=[1, 2], **settings)
    with pytest.raises(taugate.SettingsError, match="different lengths"):
        taugate.render(scene, vignetting=[[0, 1], [20]], **settings)


@pytest.mark.parametrize("lens", [dict(aperture=0.3, focus=3.2, blades=6), dict(aperture=0.05, focus=np.inf)])
def test_a_camera_keeps_its_aperture(lens):
    scene = room()
    camera = scene.camera(**lens)
    kept = dict(aperture=camera.aperture, focus=camera.focus, blades=camera.blades)
    assert kept == {"blades": 0, **lens}
    settings = dict(spp=4, sampling="uniform", gate="0m..inf")
    image = taugate.render(scene, camera=camera, **settings)
    assert np.allclose(image.pixels, taugate.render(scene, **lens, **settings).pixels, rtol=1e-3)
    assert not np.allclose(image.pixels, taugate.render(scene, **settings).pixels, rtol=1e-3)
    assert image.camera.aperture == lens["aperture"] and image.camera.focus == lens["focus"]
    # A camera of the scene, and one that was moved.
    scene.add_camera("lens", camera)
    assert np.allclose(taugate.render(scene, camera="lens", **settings).pixels, image.pixels, rtol=1e-3)
    assert camera.moved(right=0.1).aperture == lens["aperture"]


def test_the_camera_of_a_part_of_an_image_renders_this_part():
    scene = room()
    part = taugate.render(scene, spp=1, aov="depth", crop=(5, 30, 10, 20))
    again = taugate.render(scene, spp=1, aov="depth", camera=part.camera)
    assert np.allclose(again.depth, part.depth, atol=1e-4) and np.allclose(again.camera.K, part.camera.K)
    assert taugate.render(scene, spp=1, camera=part.camera, resolution=(16, 8)).pixels.shape == (8, 16, 3)


def test_settings_of_a_scene_override_its_cameras():
    scene = room()
    front = scene.camera()
    scene.settings = dict(resolution=(16, 12), fov=20)
    for camera in (scene.camera(), scene.camera(camera="front")):
        assert camera.resolution == (16, 12) and np.isclose(camera.fov, 20)
        assert np.allclose(camera.world_from_camera, front.world_from_camera)
    camera = scene.camera(resolution=(8, 8), fov=30)
    assert camera.resolution == (8, 8) and np.isclose(camera.fov, 30)
    # A camera of the call is used as it is.
    camera = scene.camera(camera=front)
    assert camera.resolution == SIZE and np.isclose(camera.fov, 40)
    scene.settings = dict(look_from=(1, 1, 5))
    assert np.allclose(scene.camera().world_from_camera[:3, 3], (1, 1, 5))
    assert np.allclose(scene.camera(camera="front").world_from_camera, front.world_from_camera)
    scene.add_camera("above", taugate.Camera.look_at((0, 4, 0.1), (0, 0, 0), resolution=SIZE))
    scene.settings = dict(camera="above")
    assert np.allclose(scene.camera().world_from_camera[:3, 3], (0, 4, 0.1))


def test_a_stereo_pair_has_the_disparity_of_its_baseline():
    scene = room()
    left, right = scene.camera().stereo(0.1)
    a, b = (taugate.render(scene, camera=camera, spp=1, aov="depth,object") for camera in (left, right))
    points = a.camera.points(a.depth)[a.depth > 0]
    (in_left, z), (in_right, _) = a.camera.project(points), b.camera.project(points)
    assert np.allclose(in_left[:, 0] - in_right[:, 0], left.K[0, 0] * 0.1 / z) and np.allclose(in_left[:, 1], in_right[:, 1])
    assert np.allclose(b.camera.world_from_camera[:3, 3], (0.1, 1.2, 4))
    # Both see one world: the points of the right image have the same heights on the wall.
    wall = b.camera.points(b.depth)[b.object == 2]
    assert np.allclose(wall[:, 2], -2, atol=1e-3)


def test_cameras_are_chosen_by_name_or_by_settings():
    scene = room()
    scene.add_camera("above", taugate.Camera.look_at((0, 4, 0.1), (0, 0, 0), resolution=SIZE))
    assert scene.info()["cameras"] == ["front", "above"]
    assert np.allclose(scene.camera(camera="above").world_from_camera[:3, 3], (0, 4, 0.1))
    assert np.allclose(scene.camera(look_from=(1, 1, 5)).world_from_camera[:3, 3], (1, 1, 5))
    parallel = scene.camera(ortho=3, look_from=(0, 1, 5), look_at=(0, 1, 0))
    assert (parallel.height, parallel.fov) == (3.0, None)
    with pytest.raises(taugate.SettingsError, match="no matrix K"):
        parallel.K
    assert taugate.render(scene, camera=parallel, spp=1).pixels.any()


def test_settings_change_the_first_camera():
    scene = room()
    front = scene.camera()
    for settings in (dict(fov=20), dict(principal_point=(0.4, 0.5)), dict(ortho=3), dict(fov=20, camera="front"), dict(ortho=3, camera=front)):
        changed = scene.camera(**settings)
        assert np.allclose(changed.world_from_camera, front.world_from_camera), settings
        assert changed.height == settings.get("ortho"), settings
        assert changed.fov is None if "ortho" in settings else np.isclose(changed.fov, settings.get("fov", 40)), settings
        assert np.allclose(changed.principal_point, settings.get("principal_point", (0.5, 0.5))), settings
    parallel = scene.camera(ortho=3)
    assert np.isclose(scene.camera(camera=parallel, fov=30).fov, 30)
    up = scene.camera(up=(1, 0, 0))
    assert np.allclose(up.world_from_camera[:3, 2:], front.world_from_camera[:3, 2:]) and up.world_from_camera[0, 1] < -0.9


def test_mistakes_in_matrices_are_explained():
    camera = room().camera()
    with pytest.raises(taugate.SettingsError, match="must be a rotation"):
        taugate.Camera.from_matrices(camera.K, 2 * camera.world_from_camera, SIZE)
    with pytest.raises(taugate.SettingsError, match="without skew"):
        taugate.Camera.from_matrices([[30.0, 2, 16], [0, 40, 16], [0, 0, 1]], np.eye(4), SIZE)
    with pytest.raises(taugate.SettingsError, match="folds inside the image"):
        folded = taugate.Camera.from_matrices(np.array([[10.0, 0, 16], [0, 10, 16], [0, 0, 1]]), np.eye(4), SIZE, distortion=(-0.9, 0, 0, 0))
        taugate.render(room(), camera=folded, spp=1)
    with pytest.raises(taugate.SettingsError, match="opencv"):
        taugate.Camera.from_matrices(camera.K, np.eye(4), SIZE, axes="colmap")
    with pytest.raises(taugate.SettingsError, match="3 x 3"):
        taugate.Camera.from_matrices(np.eye(4), np.eye(4), SIZE)
    with pytest.raises(taugate.SettingsError, match="not parallel"):
        taugate.Camera.look_at((0, 1, 0), (0, 0, 0))
    with pytest.raises(AttributeError, match="render with aov='depth'"):
        taugate.render(room(), spp=1).depth
