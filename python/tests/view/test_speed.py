"""How fast the page feels: times from an action to the first new picture on the screen."""

import os
import statistics
import time

import pytest

from .page import visit
from .program import SCENES, view

pytestmark = pytest.mark.skipif(
    "TAUGATE_ALONE" not in os.environ, reason="needs a machine that does nothing else, and TAUGATE_ALONE=1"
)

# Does an action, and answers the time in ms until a picture of later settings is on the screen.
TIME = """const done = arguments[0], picture = document.getElementById('picture');
    const before = picture.dataset.revision, start = performance.now();
    new MutationObserver((_, observer) => {
        if (picture.dataset.revision === before) return;
        observer.disconnect();
        requestAnimationFrame(() => done(performance.now() - start));
    }).observe(picture, { attributes: true });
    """
MOVE = "const field = document.getElementById('gate-to'); field.value = {}; field.dispatchEvent(new Event('change'))"
TURN = """document.getElementById('stage').dispatchEvent(
    new KeyboardEvent('keydown', { key: 'ArrowRight', bubbles: true }))"""


def median(page, actions):
    times = []
    for action in actions:
        times.append(page.run_later(TIME + action))
        time.sleep(2)
    return statistics.median(times)


def answers(scene, begin, end):
    """Prints the times until the first new picture. Returns the medians after a change of the gate and of the camera in ms."""
    with view("--gate", f"{begin}m..{end}m", scene=scene, size=(512, 512)) as viewer, visit(viewer.url) as page:
        page.until("document.getElementById('picture').dataset.size === '512x512'")
        # The first load compiled the kernels and prepared the scene, so the time of this second load excludes both.
        page.browser.refresh()
        page.until("document.getElementById('picture').dataset.revision")
        first = page.run("return performance.now()")
        moved = median(page, [MOVE.format(end + 0.3 * (end - begin) * k) for k in range(1, 6)])
        turned = median(page, 5 * [TURN])
    after = f"after a change of gate {moved:.0f} ms, of camera {turned:.0f} ms"
    print(f"{scene}: first picture of a page {first:.0f} ms; {after}")
    return moved, turned


def test_the_page_answers_soon():
    gate, camera = answers("cornell-box.glb", 6.2, 6.5)
    assert gate < 300 and camera < 300


@pytest.mark.parametrize("name, begin, end", [("staircase", 16.0, 16.14), ("city", 24.0, 31.0)])
def test_the_page_answers_soon_in_large_scenes(name, begin, end):
    scene = f"../../shared/scenes/{name}/scene.glb"
    if not (SCENES / scene).exists():
        pytest.skip(f"{scene} is not there")
    gate, camera = answers(scene, begin, end)
    assert gate < 1000 and camera < 1000
