"""Media, skies, blends, sensors, films and captures of Mitsuba. Skipped where the packages mitsuba and mitransient are not installed."""

import numpy as np
import pytest

import taugate
import test_docs
from test_mitsuba import VARIANT, bitmap, difference, mi, picture, placed


@pytest.fixture(autouse=True)
def variant():
    mi.set_variant(VARIANT)


def turned(*rotation):
    return mi.ScalarTransform4f().rotate(*rotation)


def moved(*offset):
    return mi.ScalarTransform4f().translate(offset)


def scaled(*factors):
    return mi.ScalarTransform4f().scale(factors)


def truth_of(scene, depth, spp=1024, kind="volpath"):
    scene = mi.load_dict(scene) if isinstance(scene, dict) else scene
    return np.array(mi.render(scene, integrator=mi.load_dict({"type": kind, "max_depth": depth}), spp=spp))


def image_of(scene, spp, **settings):
    """The image of taugate, by the estimator with the least noise in such scenes."""
    return taugate.render(scene, spp=spp, estimator="bdpt", **settings).pixels


def checked(scene, depth, limit, notes=(), spp=128, truth_spp=1024):
    """The converted scene and the image of Mitsuba. Their images must agree, and the scene must have these notes."""
    truth = truth_of(scene, depth, truth_spp)
    converted = taugate.from_mitsuba(scene, max_depth=depth)
    assert [note for note in converted.not_converted if "flat triangles" not in note] == list(notes)
    error = difference(image_of(converted, spp), truth)
    assert error < limit, error
    return converted, truth


# Sides of surfaces.


def merged_room():
    """Shapes that share a BSDF. The bottom of the box lies in the plane of the floor, and faces down."""
    grey = {"type": "ref", "id": "grey"}
    back = turned((1, 0, 0), 180)
    return {
        **placed({"type": "rectangle"}, scaled(2, 2, 1), bsdf=grey),
        "grey": {"type": "diffuse", "id": "grey", "reflectance": 0.7},
        "ceiling": {"type": "rectangle", "to_world": moved(0, 0, 4.5) @ back @ scaled(2, 2, 1), "bsdf": grey},
        "box": {"type": "cube", "to_world": moved(0.2, 0.1, 0.3) @ scaled(0.4, 0.3, 0.3), "bsdf": grey},
        "hidden": {"type": "rectangle", "to_world": moved(-1, 0, 0.5) @ back @ scaled(0.4, 0.4, 1), "bsdf": grey},
    }


@pytest.mark.parametrize("is_merged", [False, True])
def test_shapes_that_mitsuba_merges_have_their_own_fronts(is_merged):
    scene = merged_room()
    truth = truth_of(scene, 6)
    converted = taugate.from_mitsuba(mi.load_dict(scene) if is_merged else scene, max_depth=6)
    assert len(converted._meshes) == (1 if is_merged else 4)
    error = difference(image_of(converted, 128), truth)
    assert error < 0.03, error
    # Counterexamples: one orientation for all triangles, and surfaces with two sides.
    name, mesh = next(iter(converted._meshes.items()))
    if is_merged:
        converted.add_mesh(name, mesh["vertices"], mesh["triangles"][:, ::-1], name)
        assert difference(image_of(converted, 32), truth) > 0.3
    assert difference(image_of(taugate.from_mitsuba(scene, max_depth=6, double_sided=True), 32), truth) > 0.1


def test_scalar_variants_find_the_same_fronts():
    def fronts():
        mesh = next(iter(taugate.from_mitsuba(mi.load_dict(merged_room()))._meshes.values()))
        corners = mesh["vertices"][mesh["triangles"]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return sorted(map(tuple, np.hstack([corners.mean(axis=1), normals]).round(4).tolist()))

    found = fronts()
    mi.set_variant("scalar_rgb")
    assert fronts() == found and len(found) == 18


# Media.


def fog(**more):
    return {"type": "homogeneous", "sigma_t": 0.8, "albedo": {"type": "rgb", "value": (0.9, 0.7, 0.5)}, **more}


def over_floor(shape, medium):
    """A shape that only bounds a medium, over a floor."""
    scene = placed({"type": "rectangle"}, scaled(2, 2, 1), bsdf={"type": "diffuse", "reflectance": 0.5})
    return {**scene, "cloud": {**shape, "bsdf": {"type": "null"}, "interior": medium}}


CUBE = {"type": "cube"}
PHASES = {
    "isotropic": {"type": "isotropic"},
    "hg": {"type": "hg", "g": 0.6},
    "blend": {"type": "blendphase", "weight": 0.3, "a": {"type": "hg", "g": 0.8}, "b": {"type": "hg", "g": -0.4}},
    "table": {"type": "tabphase", "values": "2,1,0.5,0.5,1,3"},
}


@pytest.mark.parametrize("order", [("inner", "outer"), ("outer", "inner")])
def test_of_nested_media_the_inner_one_counts(order):
    boxes = {
        "inner": {**CUBE, "to_world": scaled(0.2, 0.2, 0.2), "bsdf": {"type": "null"}, "interior": fog(sigma_t=5.0)},
        "outer": {**CUBE, "bsdf": {"type": "null"}, "interior": fog()},
    }
    boxes["inner"]["exterior"] = fog()
    converted = taugate.from_mitsuba({"type": "scene", **{name: boxes[name] for name in order}})
    assert list(converted._media) == ["outer", "inner"] and not [n for n in converted.not_converted if "overlap" in n]
    boxes["inner"]["to_world"] = moved(1, 0, 0) @ scaled(0.2, 0.2, 0.2)
    notes = taugate.from_mitsuba({"type": "scene", **{name: boxes[name] for name in order}}).not_converted
    assert "the media of 'outer' and 'inner' overlap; there, that of 'inner' counts" in notes


@pytest.mark.parametrize("phase", PHASES)
def test_fog_in_a_box_has_the_image_of_mitsuba(phase):
    box = {**CUBE, "to_world": moved(0.1, 0, 0.7) @ scaled(0.9, 0.6, 0.6)}
    converted, truth = checked(over_floor(box, fog(phase=PHASES[phase])), 12, 0.04, spp=512)
    assert "cloud" not in converted._meshes
    # Counterexamples: no fog, and fog that scatters backwards.
    assert difference(image_of(converted, 64, no_medium=True), truth) > 0.1
    if phase != "isotropic":
        backwards = over_floor(box, fog(phase={"type": "hg", "g": -0.6}))
        assert difference(image_of(taugate.from_mitsuba(backwards, max_depth=12), 128), truth) > 0.05


@pytest.mark.parametrize("shape", ["sphere", "turned cube"])
def test_fog_in_a_mesh_has_the_image_of_mitsuba(shape):
    place = moved(0, 0, 0.8) @ turned((0.6, 0.8, 0), 30) @ scaled(0.7, 0.7, 0.7)
    body = {"type": "sphere" if shape == "sphere" else "cube", "to_world": place}
    converted, truth = checked(over_floor(body, fog()), 12, 0.04)
    assert converted._materials["cloud"].interior["sigma_s"] == pytest.approx([0.72, 0.56, 0.4], abs=1e-6)
    converted.remove("cloud")
    assert difference(image_of(converted, 64), truth) > 0.1


def smoke(filter="trilinear"):
    """A density grid without symmetry, in a box that is turned."""
    place = moved(0, 0, 0.8) @ turned((0, 0.6, 0.8), 40) @ scaled(1.4, 1.0, 1.2) @ moved(-0.5, -0.5, -0.5)
    data = np.random.default_rng(2).random((3, 4, 5)).astype(np.float32) ** 3
    data[:, :, 3:] = 0
    grid = {"type": "gridvolume", "grid": mi.VolumeGrid(data), "to_world": place, "filter_type": filter}
    medium = {"type": "heterogeneous", "sigma_t": grid, "albedo": 0.8, "scale": 8.0}
    return over_floor({**CUBE, "to_world": place @ moved(0.5, 0.5, 0.5) @ scaled(0.5, 0.5, 0.5)}, medium)


@pytest.mark.parametrize("filter", ["trilinear", "nearest"])
def test_smoke_in_a_grid_has_the_image_of_mitsuba(filter):
    scene = smoke(filter)
    converted, truth = checked(scene, 12, 0.04, truth_spp=2048)
    medium = converted._media["cloud"]
    assert medium["linear"] == (filter == "trilinear")
    # Counterexample: the axes of the grid run backwards.
    wrong = {**medium["medium"], "density": medium["density"][::-1, ::-1, ::-1], "transform": medium["transform"]}
    converted.add_medium("cloud", **wrong)
    assert difference(image_of(converted, 64), truth) > 0.1


def test_fog_around_the_sensor_fills_the_scene():
    air = fog(sigma_t=0.15)
    scene = placed({"type": "rectangle"}, scaled(2, 2, 1), bsdf={"type": "diffuse"}, exterior=air)
    if not hasattr(mi.load_dict(scene["sensor"]), "get_medium"):
        pytest.skip("this version of Mitsuba does not tell the medium around a sensor")
    scene["air"] = {**air, "id": "air"}
    for key in ("sensor", "bulb"):
        scene[key] = {**scene[key], "medium": {"type": "ref", "id": "air"}}
    scene["shape"] = {**scene["shape"], "exterior": {"type": "ref", "id": "air"}}
    scene = {"type": "scene", "air": scene.pop("air"), **scene}
    # Both images are noisy near the lamp.
    converted, truth = checked(scene, 12, 0.1)
    assert list(converted._media) == ["surroundings"] and image_of(converted, 128).mean() == pytest.approx(truth.mean(), rel=0.02)
    assert difference(image_of(converted, 64, no_medium=True), truth) > 0.1


def test_media_that_cannot_be_expressed_are_listed():
    small = smoke()
    small["cloud"] = {**small["cloud"], "to_world": scaled(0.3, 0.3, 0.3)}
    can = over_floor({"type": "cylinder"}, fog())
    painted = over_floor({"type": "cube"}, fog())
    painted["cloud"]["bsdf"] = {"type": "diffuse"}
    flakes = over_floor({"type": "sphere"}, fog(phase={"type": "sggx", "S": {"type": "constvolume", "value": 1.0}}))
    for scene, note in (
        (small, "the medium of the shape 'cloud' is left out: the shape is not the box of the density grid"),
        (can, "the medium of the shape 'cloud' is left out, because the shape is not closed"),
        (painted, "the medium of the shape 'cloud' is left out"),
    ):
        converted = taugate.from_mitsuba(scene)
        assert converted.not_converted[-1] == note and not converted._media, converted.not_converted
    assert "'cloud' is left out, because its phase function SGGXPhaseFunction" in taugate.from_mitsuba(flakes).not_converted[-1]


# Emitters.


def under(**emitters):
    """A ball and a floor under emitters."""
    scene = placed({"type": "rectangle"}, scaled(2, 2, 1), bsdf={"type": "diffuse", "reflectance": 0.6})
    del scene["bulb"]
    return {**scene, "ball": {"type": "cube", "to_world": moved(0, 0, 0.5) @ scaled(0.3, 0.3, 0.3)}, **emitters}


def test_a_constant_sky_has_the_image_of_mitsuba():
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": (0.5, 1.0, 2.0)}}
    converted, _ = checked(under(sky=sky), 6, 0.03)
    assert converted.settings["sky"] == [0.5, 1.0, 2.0]


def test_an_environment_map_has_the_image_of_mitsuba():
    texels = np.full((8, 16, 3), 0.1, np.float32)
    texels[1:4, 2:5], texels[5:7, 9:12] = (4, 2, 1), (0.5, 1, 3)
    sky = {"type": "envmap", "bitmap": mi.Bitmap(texels), "scale": 1.5, "to_world": turned((1, 0, 0), 90) @ turned((0, 1, 0), 70)}
    converted, truth = checked(under(sky=sky), 6, 0.05, truth_spp=2048)
    # Counterexamples: mirrored, and upside down.
    for wrong in (np.s_[:, ::-1], np.s_[::-1]):
        converted.settings = {**converted.settings, "sky": converted.settings["sky"][wrong].copy()}
        assert difference(image_of(converted, 64), truth) > 0.2


def test_a_projector_has_the_power_of_mitsuba():
    view = mi.ScalarTransform4f().look_at(origin=(0, 0, 4), target=(0, 0, 0), up=(0, 1, 0))
    light = {"type": "projector", "fov": 25, "scale": 3.0, "irradiance": {"type": "rgb", "value": (1.0, 0.5, 2.0)}, "to_world": view}
    scene = under(torch=light)
    del scene["ball"]
    truth = truth_of(scene, 2).mean(axis=(0, 1))
    converted = taugate.from_mitsuba(scene, max_depth=2)
    assert converted.not_converted == ["the projector 'torch' becomes a spot with its power and a round cone, without a picture"]
    mean = image_of(converted, 64).mean(axis=(0, 1))
    assert np.allclose(mean, truth, rtol=0.02), (mean, truth)


def test_emitters_that_cannot_be_expressed_are_listed():
    leaf = {"type": "rectangle", "emitter": {"type": "directionalarea"}}
    notes = taugate.from_mitsuba(under(sun={"type": "directional"}, leaf=leaf)).not_converted
    assert notes == [
        "the emitter of 'leaf', of the type DirectionalArea, is left out",
        "the sun 'sun' is left out: scenes from arrays have no suns; put it into a glTF file, as KHR_lights_punctual",
    ]


# BSDFs.

DIFFUSE, DARK = {"type": "diffuse", "reflectance": 0.7}, {"type": "diffuse", "reflectance": {"type": "rgb", "value": (0.1, 0.2, 0.4)}}
BLENDS = {
    "diffuse": (DIFFUSE, DARK, 0.03),
    "hole": (DIFFUSE, {"type": "null"}, 0.03),
    "plastic": (DIFFUSE, {"type": "roughplastic", "diffuse_reflectance": 0.7, "distribution": "ggx", "alpha": 0.3}, 0.06),
}


@pytest.mark.parametrize("kind", BLENDS)
def test_blends_have_the_image_of_mitsuba(kind):
    first, second, limit = BLENDS[kind]
    blend = {"type": "blendbsdf", "weight": 0.3, "first": first, "second": second}
    lamp = {"type": "disk", "to_world": moved(0.3, 1, 2) @ turned((1, 0, 0), 180), "emitter": {"type": "area", "radiance": 3.0}}
    scene = placed({"type": "rectangle"}, moved(0, 0, 0.5), bsdf=blend)
    scene = {**scene, "lamp": lamp, "below": {"type": "rectangle", "to_world": scaled(2, 2, 1), "bsdf": DARK}}
    del scene["bulb"]
    notes = ["the plastic of 'shape' has the coat of glTF, which differs by some percent"] if kind == "plastic" else []
    converted, truth = checked(scene, 4, limit, notes, truth_spp=2048)
    # Counterexample: the other weight.
    scene["shape"]["bsdf"] = {**blend, "weight": 0.9}
    assert difference(image_of(taugate.from_mitsuba(scene, max_depth=4), 64), truth) > 2 * limit


@pytest.mark.parametrize("kind", ["plastic", "roughplastic"])
def test_plastics_have_the_light_below_their_coats(kind):
    for nonlinear in (False, True):
        bsdf = {"type": kind, "diffuse_reflectance": {"type": "rgb", "value": (0.8, 0.5, 0.2)}, "nonlinear": nonlinear}
        scene = placed({"type": "rectangle"}, bsdf={**bsdf, **({"alpha": 0.3, "distribution": "ggx"} if kind == "roughplastic" else {})})
        truth = truth_of(scene, 3, 64).mean(axis=(0, 1))
        mean = image_of(taugate.from_mitsuba(scene, max_depth=3), 64).mean(axis=(0, 1))
        # The factor is right in the mean over all directions. From the front, rough plastics are up to 6 % darker.
        assert np.allclose(mean, truth, rtol=0.03 if kind == "plastic" else 0.07), (mean / truth, nonlinear)


def test_blends_that_cannot_be_expressed_become_their_heavier_part():
    blend = {"type": "blendbsdf", "weight": 0.8, "first": DIFFUSE, "second": {"type": "roughconductor", "distribution": "ggx"}}
    converted = taugate.from_mitsuba(placed({"type": "rectangle"}, bsdf=blend))
    assert converted.not_converted[-1] == "the blend in the BSDF of 'shape' becomes its heavier part"
    assert converted._materials["shape"].metallic == 1


def test_hair_and_curves_are_listed(tmp_path):
    curve = tmp_path / "curve.txt"
    curve.write_text("0 0 0 .1\n0 1 0 .1\n0 2 0 .1\n1 3 0 .1\n")
    hair = {"type": "hair"}
    scene = placed({"type": "cube"}, bsdf=hair)
    scene["strands"] = {"type": "bsplinecurve", "filename": str(curve), "bsdf": hair}
    assert taugate.from_mitsuba(scene).not_converted == [
        "the BSDF Hair of 'shape' becomes grey and diffuse",
        "the shape 'strands' of the type BSplineCurve is left out",
    ]


def test_thin_glass_has_the_image_of_mitsuba():
    tint = {"type": "rgb", "value": (0.9, 0.6, 0.3)}
    scene = placed({"type": "rectangle"}, scaled(2, 2, 1), bsdf={"type": "diffuse", "reflectance": bitmap(picture())})
    scene["pane"] = {"type": "rectangle", "to_world": moved(0, 0, 1), "bsdf": {"type": "thindielectric", "specular_transmittance": tint}}
    # The camera does not see the lamp in the pane: its mirror image would be most of the noise.
    lamp = {"type": "area", "radiance": 20.0}
    scene["lamp"] = {"type": "sphere", "to_world": moved(1, -3.5, 4) @ scaled(0.2, 0.2, 0.2), "emitter": lamp}
    del scene["bulb"]
    converted, truth = checked(scene, 8, 0.05, spp=1024, truth_spp=4096)
    converted.remove("pane")
    assert difference(image_of(converted, 64), truth) > 0.1


def test_glass_of_mitsuba_is_solid_or_thin():
    pane = placed({"type": "rectangle"}, bsdf={"type": "thindielectric", "int_ior": 1.6, "ext_ior": 1.0})
    material = taugate.from_mitsuba(pane)._materials["shape"]
    assert material.thin is True and material.ior == pytest.approx(1.6) and material.transmission == 1
    assert taugate.from_mitsuba(placed({"type": "rectangle"}, bsdf={"type": "dielectric"}))._materials["shape"].thin is False


# Sensors, films and integrators.


def layers(sensor):
    """The colour that Mitsuba sees, and that of taugate."""
    scene = placed({"type": "rectangle"}, bsdf={"type": "diffuse", "reflectance": bitmap(picture())})
    film = {**scene["sensor"]["film"], "width": 256, "height": 192}
    sensor = {**scene["sensor"], **sensor, "film": {**film, **sensor.get("film", {})}}
    scene["sensor"] = {key: value for key, value in sensor.items() if value is not None}
    truth = np.array(mi.render(mi.load_dict(scene), integrator=mi.load_dict({"type": "aov", "aovs": "a:albedo"}), spp=16))[..., :3]
    converted = taugate.from_mitsuba(scene)
    return truth, taugate.render(converted, spp=1, aov="albedo").albedo, converted


@pytest.mark.parametrize("kind", ["crop", "principal point", "orthographic"])
def test_sensors_see_the_same_part(kind):
    view = mi.ScalarTransform4f().look_at(origin=(0.6, -1.2, 3.4), target=(0, 0, 0), up=(0, 1, 0))
    sensor = {
        "crop": {"film": {"crop_offset_x": 100, "crop_offset_y": 60, "crop_width": 120, "crop_height": 96}},
        "principal point": {"principal_point_offset_x": 0.1, "principal_point_offset_y": -0.15},
        "orthographic": {"type": "orthographic", "fov": None, "to_world": view @ scaled(1.3, 1.3, 1.3), "near_clip": 0.5},
    }[kind]
    truth, albedo, converted = layers(sensor)
    assert albedo.shape == truth.shape and converted.not_converted == []
    assert difference(albedo, truth) < 0.02
    assert difference(albedo[::-1], truth) > 0.1


def test_an_orthographic_sensor_starts_at_its_near_plane():
    view = mi.ScalarTransform4f().look_at(origin=(0, 0, 3), target=(0, 0, 0), up=(0, 1, 0))
    scene = placed({"type": "rectangle"})
    film = scene["sensor"]["film"]
    scene["sensor"] = {"type": "orthographic", "to_world": view, "near_clip": 0.5, "film": film}
    depth = taugate.render(taugate.from_mitsuba(scene), spp=1, aov="depth").depth
    assert depth[12, 16] == pytest.approx(2.5, abs=1e-4)


def test_integrators_become_the_maximum_depth():
    scene = placed({"type": "rectangle"})
    for integrator, depth in (
        ({"type": "path", "max_depth": 7}, 7),
        ({"type": "volpath"}, 254),
        ({"type": "direct"}, 2),
        (None, None),
    ):
        given = {**scene, "integrator": integrator} if integrator else scene
        assert taugate.from_mitsuba(given).settings.get("max_depth") == depth
        assert taugate.from_mitsuba(given, max_depth=5).settings["max_depth"] == 5
    hidden = {**scene, "integrator": {"type": "path", "max_depth": 3, "hide_emitters": True}}
    assert taugate.from_mitsuba(hidden).not_converted == ["hide_emitters of the integrator is left out"]


def test_filters_are_listed_and_lenses_are_converted():
    scene = placed({"type": "rectangle"})
    lens = {"aperture_radius": 0.1, "focus_distance": 2.5}
    scene["sensor"] = {**scene["sensor"], "type": "thinlens", **lens, "film": {"type": "hdrfilm", "width": 32, "height": 24}}
    converted = taugate.from_mitsuba(scene)
    assert np.isclose(converted.camera().aperture, 0.2) and np.isclose(converted.camera().focus, 2.5)
    assert converted.not_converted == [
        "the filter of the sensor 'sensor', a GaussianFilter, becomes a box of one pixel",
    ]


def test_what_is_no_scene_is_refused():
    with pytest.raises(taugate.SettingsError, match="this is a Mesh|this is a Cube"):
        taugate.from_mitsuba({"type": "cube"})


# mitransient.


@pytest.fixture
def mitransient():
    found = pytest.importorskip("mitransient", reason="mitransient is not installed")
    if VARIANT == "scalar_rgb":
        pytest.skip("mitransient needs a recent LLVM: install libllvm19")
    return found


def test_films_with_travel_times_become_gates(mitransient):
    box = mitransient.cornell_box()
    box["sensor"]["film"].update(width=16, height=16)
    converted = taugate.from_mitsuba(box)
    assert converted.settings["gates"] == (3.5, pytest.approx(9.5), 300) and converted.settings["max_depth"] == 8
    assert "gates" not in taugate.from_mitsuba(box, gate="4m..5m").settings
    plain = taugate.from_mitsuba(box, gates=None, max_depth=None)
    assert image_of(plain, 4).shape == (16, 16, 3) and "max-depth = 24" in plain.experiment()
    histogram = taugate.histogram(converted, spp=4)
    assert histogram.pixels.shape == (16, 16, 300, 3)
    assert taugate.render(converted, gate="0m..inf", spp=4).pixels.shape == (16, 16, 3)
    box["integrator"]["camera_unwarp"] = True
    box["sensor"]["near_clip"] = 0.01
    assert taugate.from_mitsuba(box).not_converted == [
        "camera_unwarp of the integrator is left out",
        "travel times to the sensor 'sensor' are up to 0.01 m longer than in Mitsuba, which measures them from its near_clip",
    ]


def test_the_snippet_of_the_documentation_runs(mitransient):
    names = {"taugate": taugate}
    test_docs.run([text for label, text in test_docs.SNIPPETS if label == " mitransient"], names)
    assert names["histogram"].pixels.shape == (32, 32, 300, 3) and names["image"].pixels.any()


def capture(kind, size=(4, 3), **integrator):
    """A capture of a square that a wall hides from laser and sensor."""
    film = {"type": "transient_hdr_film", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}
    film.update(temporal_bins=60, start_opl=1.2, bin_width_opl=0.08)
    aim = mi.ScalarTransform4f().look_at(origin=(-0.5, 0, 0.3), target=(0.1, -0.2, 0), up=(0, 1, 0))
    meter = {"type": "nlos_capture_meter", "sensor_origin": (-0.5, 0, 0.3), "film": film, "sampler": {"type": "independent"}}
    turn = turned((1, 0, 0), 180)
    return {
        "type": "scene",
        "integrator": {
            "type": "transient_nlos_path", "capture_type": kind, "max_depth": 4, "temporal_filter": "box",
            "nlos_laser_sampling": True, "nlos_hidden_geometry_sampling": True, "nlos_hidden_geometry_sampling_includes_relay_wall": False,
            **integrator,
        },
        "laser": {"type": "projector", "irradiance": 100.0, "fov": 0.2, "to_world": aim},
        "wall": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": 1.0}, "meter": meter},
        "hidden": {"type": "rectangle", "to_world": moved(0.1, 0.1, 0.8) @ turn @ scaled(0.3, 0.2, 1), "bsdf": DIFFUSE},
    }


@pytest.mark.parametrize("kind", ["single", "confocal"])
@pytest.mark.parametrize("with_ways", [False, True])
def test_a_capture_around_a_corner_has_the_histogram_of_mitransient(mitransient, kind, with_ways):
    scene = capture(kind, account_first_and_last_bounces=with_ways)
    truth = np.mean([np.array(mi.render(mi.load_dict(scene), spp=20000, seed=seed)[1]) for seed in range(2)], axis=0)
    converted = taugate.from_mitsuba(scene)
    scan = taugate.scan(converted, spp=16000 if kind == "confocal" else 2000)
    data = scan.data if kind == "confocal" else scan.data[:, 0]
    truth = truth[..., :3].mean(axis=-1).reshape(12, 60).T
    assert data.shape == truth.shape
    scales = truth.sum(axis=0) / data.sum(axis=0)
    powers = np.ones(12)
    if kind == "confocal":
        # In mitransient, each point has the power that 1 m² around it gets.
        powers = np.linalg.norm(scan.laser_points - (-0.5, 0, 0.3), axis=1) ** -3.0
    assert np.allclose(scales, powers / powers.mean(), rtol=0.08), scales
    error = np.abs(data * scales - truth).sum() / truth.sum()
    assert error < 0.1, error
    # Counterexample: gates that begin one bin later.
    assert np.abs(data[:-1] * scales - truth[1:]).sum() / truth.sum() > 0.5


def test_a_capture_keeps_its_gates_beside_another_sensor(mitransient):
    scene = capture("single")
    gates = taugate.from_mitsuba(scene).settings["gates"]
    for first in (True, False):
        preview = {"preview": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}}}
        both = {"type": "scene", **(preview if first else {}), **scene, **preview}
        assert taugate.from_mitsuba(both).settings["gates"] == gates


def test_an_exhaustive_capture_and_its_mistakes(mitransient):
    table = taugate.from_mitsuba(capture("exhaustive")).scan
    assert table["laser_points"] == table["sensor_points"] and table["laser_points"]["count"] == [4, 3]
    with pytest.raises(taugate.SceneError, match="one projector as its laser, and no other emitter"):
        taugate.from_mitsuba({**capture("single"), "bulb": {"type": "point"}})
    with pytest.raises(taugate.SettingsError, match="taugate.scan"):
        image_of(taugate.from_mitsuba(capture("single")), 1)
