"""Scenes of Mitsuba. Skipped where the packages mitsuba and mitransient are not installed."""

import dataclasses
import gc
import os
import re

import numpy as np
import pytest

import taugate
import test_docs

# With LLVM 15, which Mesa's drivers install, Mitsuba ends the process. Debian's package libllvm19 has an LLVM that works.
RECENT_LLVM = "/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1"
if os.path.exists(RECENT_LLVM):
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", RECENT_LLVM)
VARIANT = "llvm_ad_rgb" if "DRJIT_LIBLLVM_PATH" in os.environ else "scalar_rgb"

mi = pytest.importorskip("mitsuba", reason="mitsuba is not installed")

SCENE = """<scene version="3.0.0">
  <sensor type="perspective" id="view"><float name="fov" value="50"/>
    <transform name="to_world"><lookat origin="0.3,1,4" target="0,0.8,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/><rfilter type="box"/></film></sensor>
  <bsdf type="twosided" id="red"><bsdf type="diffuse"><rgb name="reflectance" value="0.6,0.2,0.1"/></bsdf></bsdf>
  <shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform><ref id="red"/></shape>
  <shape type="sphere" id="ball"><point name="center" x="-0.8" y="0.5" z="0"/><float name="radius" value="0.5"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.2,0.7,0.3"/></bsdf></shape>
  <shape type="cube" id="box"><transform name="to_world"><scale value="0.3"/><translate x="0.8" y="0.4"/></transform>
    <bsdf type="BOX"/></shape>
  <shape type="disk" id="lamp"><transform name="to_world"><rotate x="1" angle="90"/><translate y="3"/></transform>
    <emitter type="area"><rgb name="radiance" value="5,4,3"/></emitter></shape>
  <emitter type="point" id="bulb"><point name="position" x="0" y="2" z="2"/><rgb name="intensity" value="3"/></emitter>
</scene>"""


def both(tmp_path, text, spp):
    """The image of Mitsuba, and that of taugate."""
    path = tmp_path / "scene.xml"
    path.write_text(text)
    mi.set_variant(VARIANT)
    scene = mi.load_file(str(path))
    truth = np.array(mi.render(scene, integrator=mi.load_dict({"type": "path", "max_depth": 8}), spp=spp))
    return truth, taugate.from_mitsuba(path, max_depth=8)


def difference(pixels, truth):
    """Largest difference of the means of 3 x 4 blocks of pixels, relative to the mean of the image. The means hide the noise."""
    blocks = lambda x: x.reshape(3, len(x) // 3, 4, -1, 3).mean(axis=(1, 3))
    return np.abs(blocks(pixels) - blocks(truth)).max() / blocks(truth).mean()


@pytest.mark.parametrize("box", ["diffuse", "dielectric"])
def test_a_scene_has_the_image_of_mitsuba(tmp_path, box):
    text = SCENE.replace("BOX", box)
    if box == "dielectric":
        # Mitsuba traces paths from the sensor. They never hit a point light, so its caustics through glass are missing.
        text = re.sub('<emitter type="point".*</emitter>\n', "", text)
    truth, scene = both(tmp_path, text, 1024)
    image = taugate.render(scene, spp=128)
    assert image.pixels.shape == truth.shape == (24, 32, 3)
    assert scene.info()["emitters"][-1] == "lamp"
    # Caustics are noisy in both. The ball has flat triangles.
    error = difference(image.pixels, truth)
    assert error < (0.09 if box == "dielectric" else 0.04), error
    # Counterexample: mirrored, the images differ.
    assert difference(image.pixels[:, ::-1], truth) > 0.2


def test_what_cannot_be_expressed_is_listed(tmp_path):
    text = SCENE.replace('<bsdf type="BOX"/>', '<bsdf type="principledthin"/>').replace("</scene>", '<emitter type="directional" id="sun"/></scene>')
    _, scene = both(tmp_path, text, 1)
    assert scene.not_converted == [
        "the sphere 'ball' is a mesh of flat triangles with smooth normals",
        "the BSDF PrincipledThin of 'box' becomes grey and diffuse",
        "the sun 'sun' is left out: scenes from arrays have no suns; put it into a glTF file, as KHR_lights_punctual",
    ]


def test_conductors_plastics_and_spots_are_converted(tmp_path):
    spot = '<emitter type="spot" id="torch"><transform name="to_world"><lookat origin="0,2,2" target="0,0,0" up="0,1,0"/></transform></emitter>'
    for bsdf in ("conductor", "roughconductor", "plastic", "roughplastic", "roughdielectric"):
        text = SCENE.replace('<bsdf type="BOX"/>', f'<bsdf type="{bsdf}"/>').replace("</scene>", spot + "</scene>")
        truth, scene = both(tmp_path, text, 64)
        assert not any("left out" in note or "grey" in note for note in scene.not_converted), scene.not_converted
        mean = taugate.render(scene, spp=32).pixels.mean()
        assert abs(mean - truth.mean()) < 0.05 * truth.mean(), (bsdf, mean, truth.mean())


def test_the_cornell_box_of_mitransient_has_the_same_gated_images():
    mitransient = pytest.importorskip("mitransient", reason="mitransient is not installed")
    if VARIANT == "scalar_rgb":
        pytest.skip("mitransient needs a recent LLVM: install libllvm19")
    mi.set_variant(VARIANT)
    start, width, count = 3.5, 1.0, 6
    box = mitransient.cornell_box()
    film = {"width": 32, "height": 32, "start_opl": start, "bin_width_opl": width, "temporal_bins": count, "rfilter": {"type": "box"}}
    box["sensor"]["film"].update(film)
    box["integrator"] = {"type": "transient_path", "max_depth": 6, "temporal_filter": "box", "camera_unwarp": False}
    seeds = [np.array(mi.render(mi.load_dict(box), spp=512, seed=seed)[1]) for seed in range(4)]
    truth, spread = np.mean(seeds, axis=0), np.std([seed.mean(axis=(0, 1)) for seed in seeds], axis=0, ddof=1) / 2
    scene = taugate.from_mitsuba(box, max_depth=6)
    result = taugate.histogram(scene, gates=(start, start + width * count, count), spp=256)
    assert result.pixels.shape == truth.shape == (32, 32, count, 3)
    means = result.pixels.mean(axis=(0, 1))
    error = np.hypot(spread, 0.003 * truth.mean(axis=(0, 1)))
    z = (means - truth.mean(axis=(0, 1))) / error
    assert np.abs(z).max() < 4.5, z
    # Counterexample: gates that lie 5 cm later.
    shifted = taugate.histogram(scene, gates=(start + 0.05, start + 0.05 + width * count, count), spp=64)
    assert np.abs((shifted.pixels.mean(axis=(0, 1)) - truth.mean(axis=(0, 1))) / error).max() > 4.5


def picture():
    """An image (6, 8, 3) without symmetry, as bytes."""
    image = np.random.default_rng(3).integers(30, 255, (6, 8, 3)).astype(np.uint8)
    image[:3, :4] = 250, 20, 20
    return image


def bitmap(texels, **more):
    return {"type": "bitmap", "bitmap": mi.Bitmap(texels), **more}


def placed(shape, to_world=None, size=(32, 24), **more):
    """A scene of one shape, as a dictionary; the camera looks at the shape from above."""
    transform = mi.ScalarTransform4f
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}
    view = transform().look_at(origin=(0.6, -1.2, 3.4), target=(0, 0, 0), up=(0, 1, 0))
    return {
        "type": "scene",
        "sensor": {"type": "perspective", "fov": 40, "film": film, "to_world": view},
        "bulb": {"type": "point", "position": (1, 0, 4), "intensity": 30.0},
        "shape": {**shape, "to_world": to_world or transform(), **more},
    }


def albedos(shape, *placement, **more):
    """The albedo that Mitsuba sees, the one that taugate sees, and what is not converted."""
    # Mitsuba shows means of pixels, and taugate the centres of pixels; with many pixels, means of blocks agree.
    scene = mi.load_dict(placed(shape, *placement, size=(256, 192), **more))
    truth = np.array(mi.render(scene, integrator=mi.load_dict({"type": "aov", "aovs": "a:albedo"}), spp=16))[..., :3]
    converted = taugate.from_mitsuba(scene)
    return truth, taugate.render(converted, spp=1, aov="albedo").albedo, converted.not_converted


def test_textures_of_a_floor_and_a_ball_have_the_image_of_mitsuba(tmp_path):
    texture = '<texture type="bitmap" name="reflectance"><string name="filename" value="picture.png"/></texture>'
    text = re.sub('<rgb name="reflectance"[^>]*/>', texture, SCENE).replace("BOX", "diffuse")
    assert text.count(texture) == 2
    mi.set_variant(VARIANT)
    mi.Bitmap(picture()).write(str(tmp_path / "picture.png"))
    truth, scene = both(tmp_path, text, 1024)
    assert scene.not_converted == ["the sphere 'ball' is a mesh of flat triangles with smooth normals"]
    error = difference(taugate.render(scene, spp=128).pixels, truth)
    assert error < 0.04, error
    # Counterexamples: images upside down and mirrored.
    for wrong in (picture()[::-1], picture()[:, ::-1]):
        mi.Bitmap(wrong.copy()).write(str(tmp_path / "picture.png"))
        assert difference(taugate.render(taugate.from_mitsuba(tmp_path / "scene.xml", max_depth=8), spp=16).pixels, truth) > 0.5


@pytest.mark.parametrize("filter_type", ["nearest", "bilinear"])
@pytest.mark.parametrize("wrap_mode", ["repeat", "mirror", "clamp"])
def test_textures_are_placed_and_continued_as_in_mitsuba(wrap_mode, filter_type):
    mi.set_variant(VARIANT)
    to_uv = mi.ScalarTransform4f().rotate((0, 0, 1), 30) @ mi.ScalarTransform4f().scale((2.5, 2, 1)) @ mi.ScalarTransform4f().translate((0.2, -0.4, 0))
    texture = bitmap(picture(), wrap_mode=wrap_mode, filter_type=filter_type, to_uv=to_uv)
    truth, albedo, notes = albedos({"type": "rectangle"}, bsdf={"type": "diffuse", "reflectance": texture})
    assert difference(albedo, truth) < 0.02 and notes == []
    # Counterexamples: the other modes.
    others = [mode for mode in ("repeat", "mirror", "clamp") if mode != wrap_mode]
    for wrong in others:
        other = {**texture, "wrap_mode": wrong}
        _, albedo, _ = albedos({"type": "rectangle"}, bsdf={"type": "diffuse", "reflectance": other})
        assert difference(albedo, truth) > 0.06


def without_uvs(path, **more):
    """A square without texture coordinates, and four triangles without area."""
    mesh = mi.Mesh("mesh", 4, 6)
    values = mi.traverse(mesh)
    values["vertex_positions"] = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32).ravel()
    values["faces"] = np.array([(0, 0, 2), (2, 2, 0), (1, 1, 3), (3, 3, 1), (0, 1, 2), (0, 2, 3)], np.uint32).ravel()
    values.update()
    mesh.write_ply(str(path))
    return {"type": "ply", "filename": str(path), "face_normals": True, **more}


SHAPES = {"cube": {}, "disk": {}, "sphere": {}, "cylinder": {}, "without_uvs": {}, "flipped": {"flip_normals": True}}


@pytest.mark.parametrize("kind", SHAPES)
def test_shapes_have_the_texture_coordinates_of_mitsuba(tmp_path, kind):
    mi.set_variant(VARIANT)
    shape = {"type": kind} if kind in ("cube", "disk", "sphere", "cylinder") else without_uvs(tmp_path / "square.ply", **SHAPES[kind])
    # Shows the seam and a pole of the sphere.
    tilt = mi.ScalarTransform4f().rotate((1, 0, 0), 40) @ mi.ScalarTransform4f().rotate((0, 0, 1), -100)
    bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": bitmap(picture())}}
    truth, albedo, _ = albedos({**shape, "bsdf": bsdf}, tilt if kind in ("cube", "sphere", "cylinder") else None)
    # Shapes of triangles have other outlines than round shapes.
    error = difference(albedo, truth)
    assert error < 0.03, error


def test_triangles_without_area_do_not_hide_that_a_mesh_is_flipped(tmp_path):
    mi.set_variant(VARIANT)
    for flip in (False, True):
        mesh = taugate.from_mitsuba(placed(without_uvs(tmp_path / "square.ply", flip_normals=flip)))._meshes["shape"]
        a, b, c = mesh["vertices"][mesh["triangles"][-1]]
        assert (np.cross(b - a, c - a)[2] < 0) == flip


EDGES = {
    "one texel": picture()[:1, :1],
    "one channel": picture()[..., :1].copy(),
    "alpha": np.dstack([picture(), picture()[..., :1]]),
    "16 bits": picture().astype(np.uint16) * 257,
    "floats": (picture() / 255).astype(np.float32),
}


@pytest.mark.parametrize("raw", [False, True])
@pytest.mark.parametrize("edge", EDGES)
def test_bitmaps_of_all_types_have_the_colours_of_mitsuba(tmp_path, edge, raw):
    mi.set_variant(VARIANT)
    path = str(tmp_path / ("x.exr" if edge == "floats" else "x.png"))
    mi.Bitmap(EDGES[edge]).write(path)
    texture = {"type": "bitmap", "filename": path, "raw": raw}
    truth, albedo, notes = albedos({"type": "rectangle"}, bsdf={"type": "diffuse", "reflectance": texture})
    assert difference(albedo, truth) < 0.02 and notes == []


def test_checkerboards_and_nested_textures_are_sampled():
    mi.set_variant(VARIANT)
    scale = mi.ScalarTransform4f().scale((3, 2, 1))
    board = {"type": "checkerboard", "color0": {"type": "rgb", "value": (0.8, 0.1, 0.1)}, "color1": {"type": "rgb", "value": 0.3}, "to_uv": scale}
    truth, albedo, notes = albedos({"type": "rectangle"}, bsdf={"type": "diffuse", "reflectance": board})
    assert difference(albedo, truth) < 0.02 and notes == []
    nested = {**board, "color0": bitmap(picture())}
    truth, albedo, notes = albedos({"type": "rectangle"}, bsdf={"type": "diffuse", "reflectance": nested})
    assert difference(albedo, truth) < 0.02
    assert len(notes) == 1 and re.fullmatch("the texture reflectance of the BSDF of 'shape' is sampled at .* points", notes[0])


def metal_floor(alpha, **more):
    """A glossy floor under a lamp."""
    metal = {"type": "roughconductor", "distribution": "ggx", "alpha": alpha, **more}
    scene = placed({"type": "rectangle"}, bsdf={"type": "twosided", "bsdf": metal})
    facing_down = mi.ScalarTransform4f().translate((0.3, 1, 2)) @ mi.ScalarTransform4f().rotate((1, 0, 0), 180)
    lamp = {"type": "area", "radiance": 3.0}
    return {**scene, "lamp": {"type": "disk", "to_world": facing_down, "emitter": lamp}}


@pytest.mark.parametrize("filter_type", ["nearest", "bilinear"])
def test_textures_of_roughness_and_of_specular_reflectance_have_the_image_of_mitsuba(filter_type):
    mi.set_variant(VARIANT)
    # Left half glossy, right half rough.
    texels = np.linspace(0.1, 0.7, 8, dtype=np.float32) * np.ones((4, 1), np.float32)
    alpha = bitmap(texels[..., None], raw=True, filter_type=filter_type)
    # The two textures have different transforms.
    turned = mi.ScalarTransform4f().rotate((0, 0, 1), 90)
    scene = metal_floor(alpha, specular_reflectance=bitmap(picture(), to_uv=turned))
    truth = np.array(mi.render(mi.load_dict(scene), integrator=mi.load_dict({"type": "path", "max_depth": 4}), spp=4096))
    converted = taugate.from_mitsuba(scene, max_depth=4)
    assert not any("mean" in note for note in converted.not_converted), converted.not_converted
    error = difference(taugate.render(converted, spp=256).pixels, truth)
    assert error < 0.04, error
    # Counterexample: uniform roughness.
    wrong = taugate.from_mitsuba({**scene, "shape": metal_floor(0.4)["shape"]}, max_depth=4)
    assert difference(taugate.render(wrong, spp=64).pixels, truth) > 0.1


def principled_scene(**parameters):
    """A rectangle of the principled BSDF under a lamp; if the BSDF transmits light, a cube over a diffuse floor."""
    bsdf = {"type": "principled", "base_color": {"type": "rgb", "value": (0.7, 0.5, 0.2)}, **parameters}
    is_glass = "spec_trans" in parameters
    above = mi.ScalarTransform4f().translate((0, 0, 0.5)) @ mi.ScalarTransform4f().rotate((0, 0, 1), 30) @ mi.ScalarTransform4f().scale(0.35)
    large = mi.ScalarTransform4f().scale((2, 2, 1))
    box = {"shape": {"type": "cube", "to_world": above, "bsdf": bsdf}, "floor": {"type": "rectangle", "to_world": large}}
    scene = metal_floor(0.1)
    scene["shape"] = {"type": "rectangle", "to_world": large, "bsdf": {"type": "twosided", "bsdf": bsdf}}
    scene["sensor"]["to_world"] = mi.ScalarTransform4f().look_at(origin=(0.6, -2.2, 2.4), target=(0, 0, 0), up=(0, 0, 1))
    scene["sensor"]["film"].update(width=16, height=12)
    del scene["bulb"]
    return {**scene, **box} if is_glass else scene


def glossy(roughness, metallic=0.0):
    """Changes of a material: alpha is the roughness instead of its square. At 0.8, a wide highlight hides this unless it is that of a metal."""
    return [{"roughness": roughness**0.5}] if roughness < 0.8 or metallic > 0 else []


ROUGHNESSES = (0.1, 0.4, 0.8)
# Parameters, bounds of the error of the mean, limit of the errors of blocks, and wrong materials that exceed this limit.
PRINCIPLED = [
    *(({"metallic": 0.0, "specular": 0.0, "roughness": r}, (-0.02, 0.02), 0.07, [{"color": (0.5, 0.5, 0.5)}]) for r in ROUGHNESSES),
    *(
        ({"metallic": m, "specular": s, "roughness": r}, bounds, limit, [{"metallic": 0.5 if m != 0.5 else 0.0}, *glossy(r, m)])
        for m, s, bounds, limit in (
            (0.0, 0.5, (-0.05, 0.01), 0.1),
            (0.0, 1.0, (-0.08, 0.00), 0.16),
            (0.5, 0.5, (-0.03, 0.01), 0.08),
            (0.5, 1.0, (-0.05, 0.01), 0.12),
            (1.0, 0.5, (-0.02, 0.02), 0.06),
            (1.0, 1.0, (-0.02, 0.02), 0.06),
        )
        for r in ROUGHNESSES
    ),
    *(({"spec_trans": 1.0, "eta": 1.5, "roughness": r}, (-0.02, 0.02), 0.1, [{"color": (0.7, 0.5, 0.2)}, *glossy(r)]) for r in ROUGHNESSES),
    ({"specular": 1.0, "spec_tint": 1.0, "roughness": 0.3}, (-0.09, 0.00), 0.2, [{"specular_color": (1.0, 1.0, 1.0)}]),
    *(
        ({"clearcoat": 1.0, "clearcoat_gloss": g, "metallic": 1.0, "roughness": 0.5}, (-0.06, 0.0), 0.25, [{"clearcoat_roughness": 0.0}])
        for g in (0.0, 0.5)
    ),
]


@pytest.mark.parametrize("case", PRINCIPLED, ids=lambda case: " ".join(f"{key}={value}" for key, value in case[0].items()))
def test_the_principled_bsdf_has_the_image_of_mitsuba(case):
    mi.set_variant(VARIANT)
    parameters, bounds, limit, changes = case
    scene, depth = principled_scene(**parameters), 8 if "spec_trans" in parameters else 3
    truth = np.array(mi.render(mi.load_dict(scene), integrator=mi.load_dict({"type": "path", "max_depth": depth}), spp=4096))
    converted = taugate.from_mitsuba(scene, max_depth=depth)
    material = converted._materials["shape"]
    pixels = taugate.render(converted, spp=256).pixels
    mean, error = pixels.mean() / truth.mean() - 1, difference(pixels, truth)
    assert bounds[0] < mean < bounds[1] and error < limit, (mean, error)
    # Counterexamples.
    for change in changes:
        converted.add_material("shape", dataclasses.replace(material, **change))
        error = difference(taugate.render(converted, spp=256).pixels, truth)
        assert error > limit, (change, error)


def test_what_the_principled_bsdf_loses_is_listed():
    mi.set_variant(VARIANT)
    diffuse = "the diffuse part of the BSDF of 'shape' is that of glTF; its albedo is from 9 % lower to 5 % higher"
    of = "of the BSDF of 'shape'"
    metal = {"metallic": 1.0}
    for parameters, notes in (
        ({}, [diffuse]),
        (metal, []),
        ({**metal, "anisotropic": 0.5, "sheen": 0.2, "flatness": 0.1}, [f"{key} {of} is left out" for key in ("anisotropic", "sheen", "flatness")]),
        ({**metal, "specular": 0.0}, ["the metal of the BSDF of 'shape' reflects light; in Mitsuba it is black, because its specular is 0"]),
        ({"eta": 0.8}, [f"eta {of} is below 1; it becomes 1", diffuse]),
        ({"spec_trans": 0.5}, [diffuse, f"base_color {of} becomes a mix of itself and its square root, which is the colour of the glass"]),
        ({"spec_trans": 1.0, "spec_tint": 1.0}, [f"spec_tint {of} is left out for its glass"]),
        ({"base_color": bitmap(picture()), "spec_tint": 1.0}, [diffuse, f"spec_tint {of} has the mean colour of the texture base_color"]),
        (
            {**metal, "clearcoat": 0.5},
            ["the clear coat of the BSDF of 'shape' is that of glTF: GGX instead of GTR1, stronger at grazing angles, over darker layers"],
        ),
        ({**metal, "clearcoat": bitmap(picture()[..., :1].copy())}, [f"the texture clearcoat {of} becomes its mean colour", None]),
    ):
        found = taugate.from_mitsuba(principled_scene(**parameters)).not_converted
        assert len(found) == len(notes) and all(note in (None, other) for note, other in zip(notes, found)), (parameters, found)


def ramp(height, width, low, high):
    """Numbers that grow to the right, as floats (H, W, 1)."""
    return (np.linspace(low, high, width, dtype=np.float32) * np.ones((height, 1), np.float32))[..., None]


def test_textures_of_the_principled_bsdf_have_the_image_of_mitsuba():
    mi.set_variant(VARIANT)
    # The metalness has more columns and fewer rows than the roughness.
    roughness, metallic = bitmap(ramp(6, 4, 0.2, 0.8), raw=True), bitmap(ramp(3, 8, 1.0, 0.0), raw=True)
    scene = principled_scene(base_color=bitmap(picture()), roughness=roughness, metallic=metallic)
    truth = np.array(mi.render(mi.load_dict(scene), integrator=mi.load_dict({"type": "path", "max_depth": 3}), spp=4096))
    converted = taugate.from_mitsuba(scene, max_depth=3)
    assert converted.not_converted == ["the diffuse part of the BSDF of 'shape' is that of glTF; its albedo is from 9 % lower to 5 % higher"]
    error = difference(taugate.render(converted, spp=256).pixels, truth)
    assert error < 0.1, error
    material = converted._materials["shape"]
    assert material.roughness_texture.texels.shape == material.metallic_texture.texels.shape == (48, 64)
    # Counterexamples: one of the textures is missing.
    for change in ({"roughness_texture": None, "roughness": 0.5}, {"metallic_texture": None, "metallic": 0.5}, {"texture": None}):
        converted.add_material("shape", dataclasses.replace(material, **change))
        assert difference(taugate.render(converted, spp=256).pixels, truth) > 0.2, change


def test_glass_has_the_square_root_of_a_texture():
    mi.set_variant(VARIANT)
    glass = taugate.from_mitsuba(principled_scene(base_color=bitmap(ramp(2, 4, 0.1, 0.9), raw=True), spec_trans=1.0))._materials["shape"]
    linear = np.where(glass.texture.texels / 255 < 0.04045, glass.texture.texels / 255 / 12.92, ((glass.texture.texels / 255 + 0.055) / 1.055) ** 2.4)
    assert np.allclose(linear[..., :3], np.sqrt(ramp(2, 4, 0.1, 0.9)), atol=0.005)


def test_the_metalness_becomes_its_mean_where_its_texture_lies_elsewhere():
    mi.set_variant(VARIANT)
    turned = mi.ScalarTransform4f().rotate((0, 0, 1), 90)
    scene = principled_scene(roughness=bitmap(ramp(2, 4, 0.1, 0.9), raw=True), metallic=bitmap(ramp(2, 4, 0.2, 0.4), raw=True, to_uv=turned))
    converted = taugate.from_mitsuba(scene)
    material = converted._materials["shape"]
    assert "the texture metallic of the BSDF of 'shape' becomes its mean colour" in converted.not_converted
    assert abs(material.metallic - 0.3) < 1e-3 and material.metallic_texture is None and material.roughness_texture is not None


def test_parameters_may_share_a_texture():
    mi.set_variant(VARIANT)
    # Mitsuba makes one object of the two bitmaps, and lists this object once.
    shared = bitmap(picture())
    scene = taugate.from_mitsuba(metal_floor(shared, specular_reflectance=shared))
    material = scene._materials["shape"]
    assert material.texture.texels.shape == (6, 8, 4) and material.roughness_texture.texels.shape == (48, 64)


def test_what_sides_spots_and_sensors_lose_is_listed():
    mi.set_variant(VARIANT)
    sides = {"type": "twosided", "front": {"type": "diffuse"}, "back": {"type": "plastic"}}
    same = {"type": "twosided", "only": {"type": "diffuse"}}
    area = {"type": "area", "radiance": {"type": "rgb", "value": 2.0}}
    film = {"type": "hdrfilm", "rfilter": {"type": "box"}}
    scene = {
        "type": "scene",
        "leaf": {"type": "rectangle", "bsdf": sides},
        "panel": {"type": "rectangle", "bsdf": same, "emitter": area},
        "lamp": {"type": "rectangle", "emitter": area},
        "wide": {"type": "perspective", "film": film},
        "cut": {"type": "perspective", "near_clip": 1.0, "film": film},
    }
    assert sorted(taugate.from_mitsuba(scene).not_converted) == [
        "near_clip of the sensor 'cut' is left out",
        "the back of the BSDF of 'leaf' is like its front",
        "the back of the emitter 'panel' reflects no light",
    ]
    if mi.__version__ >= "3.9":
        torch = {"type": "spot", "id": "torch", "texture": bitmap(picture())}
        assert "texture of the spot 'torch' is left out" in taugate.from_mitsuba({"type": "scene", "torch": torch}).not_converted


def test_bsdfs_around_other_bsdfs_keep_their_textures():
    mi.set_variant(VARIANT)
    diffuse = {"type": "diffuse", "reflectance": bitmap(picture())}
    relief = {"type": "checkerboard"}
    for wrapper, note in (
        ({"type": "bumpmap", "relief": relief, "bsdf": diffuse}, "bump map"),
        ({"type": "twosided", "bsdf": {"type": "normalmap", "normalmap": relief, "bsdf": diffuse}}, "normal map"),
    ):
        truth, albedo, notes = albedos({"type": "rectangle"}, bsdf=wrapper)
        assert notes == [f"the {note} of the BSDF of 'shape' is left out"]
        assert difference(albedo, truth) < 0.02


def test_masks_let_light_through():
    mi.set_variant(VARIANT)
    up = mi.ScalarTransform4f().translate((0, 0, 1))
    mask = {"type": "mask", "opacity": 0.3, "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": 0.9}}}
    scene = placed({"type": "rectangle"}, bsdf={"type": "diffuse", "reflectance": bitmap(picture())})
    scene["mask"] = {"type": "rectangle", "to_world": up, "bsdf": mask}
    # Of Mitsuba's path tracers, only this one sees lights through masks.
    truth = np.array(mi.render(mi.load_dict(scene), integrator=mi.load_dict({"type": "volpath", "max_depth": 12}), spp=1024))
    converted = taugate.from_mitsuba(scene, max_depth=6)
    assert converted.not_converted == []
    error = difference(taugate.render(converted, spp=128).pixels, truth)
    assert error < 0.04, error


@pytest.mark.parametrize("color", ["constant", "texture", "smaller texture", "texture of one colour"])
def test_masks_with_a_texture_have_holes(color):
    mi.set_variant(VARIANT)
    up = mi.ScalarTransform4f().translate((0, 0, 1))
    opacity = np.random.default_rng(5).random((4, 6, 1)).astype(np.float32)
    texels = np.repeat(picture(), 2, axis=0) if color == "texture" else picture()[2:4, 3:5].copy()
    reflectance = {"type": "rgb", "value": (0.9, 0.5, 0.2)} if color == "constant" else bitmap(texels)
    if color == "texture of one colour":
        reflectance = bitmap(texels[:1, :1].copy())
    diffuse = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": reflectance}}
    scene = placed({"type": "rectangle"}, bsdf={"type": "diffuse", "reflectance": 0.5})
    scene["mask"] = {"type": "rectangle", "to_world": up, "bsdf": {"type": "mask", "opacity": bitmap(opacity, raw=True), "bsdf": diffuse}}
    truth = np.array(mi.render(mi.load_dict(scene), integrator=mi.load_dict({"type": "volpath", "max_depth": 12}), spp=1024))
    converted = taugate.from_mitsuba(scene, max_depth=6)
    assert converted.not_converted == []
    error = difference(taugate.render(converted, spp=256).pixels, truth)
    assert error < 0.05, error
    # Counterexample: the mean opacity.
    scene["mask"]["bsdf"]["opacity"] = float(opacity.mean())
    assert difference(taugate.render(taugate.from_mitsuba(scene, max_depth=6), spp=64).pixels, truth) > 0.15


def test_masks_that_lie_elsewhere_than_the_colour_become_their_mean():
    mi.set_variant(VARIANT)
    opacity = bitmap(ramp(2, 4, 0.2, 0.4), raw=True, wrap_mode="clamp")
    mask = {"type": "mask", "opacity": opacity, "bsdf": {"type": "diffuse", "reflectance": bitmap(picture())}}
    converted = taugate.from_mitsuba(placed({"type": "rectangle"}, bsdf=mask))
    assert converted.not_converted == ["the texture opacity of the BSDF of 'shape' becomes its mean colour"]
    material = converted._materials["shape"]
    assert abs(material.alpha - 0.3) < 1e-3 and material.texture.texels[..., 3].min() == 255


def test_the_conversion_leaves_no_objects_of_mitsuba_to_the_garbage_collector():
    # During a render, the collector would delete them, and Mitsuba would end the process.
    mi.set_variant(VARIANT)
    scene = mi.load_dict(placed({"type": "rectangle"}, bsdf={"type": "diffuse", "reflectance": bitmap(picture())}))
    gc.collect()
    before = gc.get_debug()
    gc.set_debug(gc.DEBUG_SAVEALL)
    try:
        taugate.from_mitsuba(scene)
        gc.collect()
        found = [item for garbage in gc.garbage for item in gc.get_referents(garbage) if isinstance(item, mi.Object)]
    finally:
        gc.set_debug(before)
        gc.garbage.clear()
    assert not found


def test_textures_that_cannot_be_expressed_are_listed():
    mi.set_variant(VARIANT)
    lamp = {"type": "area", "radiance": bitmap(picture())}
    attribute = {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}}
    far = mi.ScalarTransform4f().scale((1e9, 1e9, 1))
    hole = (picture() / 255).astype(np.float32)
    hole[0, 0], hole[1, 0] = np.nan, 3
    scene = {
        **placed({"type": "rectangle"}, emitter=lamp),
        "painted": {"type": "cube", "bsdf": attribute},
        "broken": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": bitmap(hole)}},
        "plastic": {"type": "rectangle", "bsdf": {"type": "plastic", "specular_reflectance": bitmap(picture())}},
        "far": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": bitmap(picture(), to_uv=far)}},
    }
    notes = taugate.from_mitsuba(scene).not_converted
    for note in (
        "the texture radiance of the emitter of 'shape' becomes its mean colour",
        "the texture reflectance of the BSDF of 'painted', a MeshAttribute, becomes 0.5",
        "3 values of the texture reflectance of the BSDF of 'broken' are not numbers; they become 0",
        "3 values of the texture reflectance of the BSDF of 'broken' are below 0 or above 1; they are clipped",
        "specular_reflectance of the BSDF of 'plastic' is left out",
        "the texture reflectance of the BSDF of 'far' becomes its mean colour",
    ):
        assert note in notes, notes
    # The mean colour of the bitmap, decoded.
    truth = np.where(picture() / 255 < 0.04045, picture() / 255 / 12.92, ((picture() / 255 + 0.055) / 1.055) ** 2.4).mean(axis=(0, 1))
    assert np.allclose(taugate.from_mitsuba(scene)._materials["shape"].emission, truth, rtol=1e-3)


def test_old_versions_of_mitsuba_are_refused(monkeypatch):
    monkeypatch.setattr(mi, "__version__", "3.6.4")
    with pytest.raises(ImportError, match="needs Mitsuba 3.7 or newer, but this is 3.6.4"):
        taugate.from_mitsuba(placed({"type": "rectangle"}))


def test_a_missing_bitmap_is_an_error_of_mitsuba(tmp_path):
    texture = '<texture type="bitmap" name="reflectance"><string name="filename" value="nowhere.png"/></texture>'
    path = tmp_path / "scene.xml"
    path.write_text(re.sub('<rgb name="reflectance"[^>]*/>', texture, SCENE).replace("BOX", "diffuse"))
    with pytest.raises(RuntimeError, match="nowhere.png"):
        taugate.from_mitsuba(path)


def test_the_snippets_of_the_documentation_run(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib").use("Agg")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.xml").write_text(SCENE.replace("BOX", "diffuse"))
    mi.set_variant(VARIANT)
    snippets = [text for label, text in test_docs.SNIPPETS if label == " mitsuba"]
    assert len(snippets) == 2
    names = {"taugate": taugate}
    test_docs.run(snippets, names)
    assert names["scene"].not_converted == []


def test_shapes_share_a_large_texture():
    mi.set_variant(VARIANT)
    texels = np.zeros((2048, 2048, 3), np.uint8)
    texels[100:200, 300:400] = 200
    bsdf = {"type": "diffuse", "id": "shared", "reflectance": bitmap(texels)}
    scene = {**placed({"type": "rectangle"}, bsdf=bsdf), "other": {"type": "sphere", "bsdf": {"type": "ref", "id": "shared"}}}
    materials = taugate.from_mitsuba(scene)._materials
    assert materials["shape"].texture.texels is materials["other"].texture.texels
    assert materials["shape"].texture.texels.dtype == np.uint8
