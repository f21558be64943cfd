"""The page shows the same image as the file that it saves. `taugate render` computes this image too, up to noise."""

import re

import numpy as np
import pytest

from .page import visit
from .program import SIZE, agree, render_box, view

OpenEXR = pytest.importorskip("OpenEXR")

# Exposure of the pictures in EV.
STOPS = 3.0
# The browser loses the WebGL2 context and restores it.
LOSE = """const picture = document.getElementById('picture');
    const context = picture.getContext('webgl2').getExtension('WEBGL_lose_context');
    picture.addEventListener('webglcontextlost', () => setTimeout(() => context.restoreContext()), { once: true });
    picture.addEventListener('webglcontextrestored', () => arguments[0](), { once: true });
    context.loseContext();"""


def pixels(path):
    """R, G, B of an image file."""
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return np.stack([channels[name].pixels for name in "RGB"], axis=-1).astype(np.float32)


def expose(rgb, stops):
    """Multiplies linear values by a factor and encodes them to sRGB bytes (IEC 61966-2-1)."""
    x = np.clip(rgb * np.float32(2**stops), 0, 1)
    srgb = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return (255 * srgb + 0.5).astype(np.uint8)


def largest_difference(a, b):
    assert a.shape == b.shape
    return np.abs(a.astype(int) - b.astype(int)).max()


def test_the_screen_shows_what_is_saved_and_what_render_makes(tmp_path):
    with view("--gate", "6.2m..6.5m") as viewer, visit(viewer.url) as page:
        page.picture_after(0, 32)
        assert page.run("return document.getElementById('picture').dataset.painter") == "WebGL2"
        page.enter("#stops", "3")
        page.pause()

        saved = page.save(viewer, "first")
        expected = expose(pixels(saved), STOPS)
        screen = page.screen()
        assert (screen > 100).any()
        assert largest_difference(screen, expected) <= 1, "the screen differs from the file"
        dimmer = expose(pixels(saved), STOPS - 0.1)
        assert largest_difference(screen, dimmer) > 1

        page.run_later(LOSE)
        assert largest_difference(page.shot(), expected) <= 1, "the picture is not drawn again"

        reference = render_box(tmp_path, "--gate", "6.2m..6.5m")
        assert agree(saved, reference), "the saved image is not that of taugate render"
        other = render_box(tmp_path, "--gate", "6.3m..6.6m")
        assert not agree(saved, other), "the comparison would not notice a wrong gate"

        # The page refuses to overwrite a file, and says so.
        page.enter("#save-name", "first")
        page.until("document.querySelector('.alert.problem')?.textContent.includes('first.exr')")

        # The same picture without WebGL2.
        page.browser.get(viewer.url.replace("/#", "/?2d#"))
        page.picture_after(0, 8)
        assert page.run("return document.getElementById('picture').dataset.painter") == "2D canvas"
        page.enter("#stops", "3")
        assert largest_difference(page.screen(), expected) <= 1, "the 2D canvas shows something else"

        paused = page.run("return document.getElementById('picture').dataset.samples")
        page.go_on()
        page.until(f"document.getElementById('picture').dataset.samples > {paused}")
        page.says_nothing()


def test_pixels_have_values_and_errors():
    with view("--gate", "6.2m..6.5m") as viewer, visit(viewer.url) as page:
        page.picture_after(0, 8)
        page.until("document.getElementById('relmse').textContent !== '–'")
        page.pause()
        saved = page.save(viewer, "values")
        page.click("#stage")
        page.until("document.getElementById('readout-place').textContent.startsWith('Held')")
        place = page.text("#readout-place")
        x, y = map(int, re.findall("[0-9]+", place))
        assert abs(x - SIZE // 2) <= 1 and abs(y - SIZE // 2) <= 1, f"{place} is not the middle"
        page.until("document.getElementById('readout-radiance').textContent.includes('±')")
        expected = pixels(saved)[y, x, 0]
        shown = page.text("#readout-radiance")
        red = float(shown.lstrip("R (").split(" ")[0])
        assert abs(red - expected) <= 0.05 * expected, shown
        page.until("/depth [0-9.]+ m · [a-z]/.test(document.getElementById('readout-more').textContent)")

        # The picture of the error differs from the picture of the radiance.
        radiance = page.screen()
        page.click("[value=error]")
        page.until("document.getElementById('picture').dataset.layer === 'error'")
        page.until("!document.getElementById('legend').hidden")
        assert largest_difference(page.screen(), radiance) > 50
        page.says_nothing()


def shows(page, layer):
    page.click(f"[value={layer}]")
    page.until(f"document.getElementById('picture').dataset.layer === '{layer}'")
    return page.screen().astype(int)


def test_depths_normals_and_an_earlier_picture_are_shown():
    with view("--gate", "6.2m..6.5m") as viewer, visit(viewer.url) as page:
        page.picture_after(0, 8)
        page.until("document.getElementById('relmse').textContent !== '–'")
        page.pause()
        # The back wall of the box faces +z, towards the camera; the floor faces +y.
        normals = shows(page, "normal")
        assert np.abs(normals[SIZE // 4, SIZE // 2] - [128, 128, 255]).max() <= 3, normals[SIZE // 4, SIZE // 2]
        assert np.abs(normals[-2, SIZE // 2] - [128, 255, 128]).max() <= 3, normals[-2, SIZE // 2]
        # In viridis, far surfaces are yellow and near ones are violet.
        depths = shows(page, "depth")
        wall, floor = depths[SIZE // 4, SIZE // 2], depths[-1, SIZE // 2]
        assert wall[0] > wall[2] and floor[2] > floor[0], f"{wall} {floor}"

        # A is the picture of the first gate, B that of another one. They differ, and each is shown again.
        first = shows(page, "mean")
        page.click("#keep")
        page.enter("#gate-from", "7")
        page.until("document.getElementById('picture').dataset.revision > 1")
        page.click("#auto")
        second = page.screen().astype(int)
        page.click("[name=compare][value=a]")
        a = page.screen().astype(int)
        assert np.abs(a - second).max() > 30
        page.click("[name=compare][value=difference]")
        difference = page.screen().astype(int)
        page.click("[name=compare][value=b]")
        assert np.abs(page.screen().astype(int) - second).max() == 0
        # Where one of the two is black, the difference is the other one.
        alone = (second.max(axis=2) == 0) & (a.max(axis=2) > 0)
        assert alone.any() and np.abs(difference - a)[alone].max() <= 1
        assert first.shape == a.shape
        page.says_nothing()
