"""Scenes of Mitsuba. Skipped where the packages mitsuba and mitransient are not installed."""

import os
import re

import numpy as np
import pytest

import taugate

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
    # Means of blocks of 8 x 8 pixels, which hide the noise. The ball has flat triangles.
    blocks = lambda x: x.reshape(3, 8, 4, 8, 3).mean(axis=(1, 3))
    relative = np.abs(blocks(image.pixels) - blocks(truth)) / blocks(truth).mean()
    # Caustics are noisy in both.
    assert relative.max() < (0.09 if box == "dielectric" else 0.04), relative.max()
    # Counterexample: mirrored, the images differ.
    assert (np.abs(blocks(image.pixels[:, ::-1]) - blocks(truth)) / blocks(truth).mean()).max() > 0.2


def test_what_cannot_be_expressed_is_listed(tmp_path):
    text = SCENE.replace('<bsdf type="BOX"/>', '<bsdf type="principled"/>').replace("</scene>", '<emitter type="constant" id="sky"/></scene>')
    _, scene = both(tmp_path, text, 1)
    assert scene.not_converted == [
        "the sphere 'ball' is a mesh of flat triangles with smooth normals",
        "the BSDF Principled of 'box' becomes grey and diffuse",
        "the emitter 'sky' of the type ConstantBackgroundEmitter is left out",
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
