"""Makes the pictures of the page for README and guide; `docs/pictures/make.sh` runs this."""

import os
import pathlib

import pytest

from .page import Keys, visit
from .program import view

WINDOW = (1280, 930)
# The render may take this many seconds to reach its target.
PATIENCE = 600


def take(page, name, target):
    """Writes what the window shows to the folder that TAUGATE_PICTURES names, when relMSE is below the target."""
    page.enter("#target", target)
    page.until("document.getElementById('target-time').textContent === 'reached'", PATIENCE)
    page.pause()
    assert page.browser.save_screenshot(str(pathlib.Path(os.environ["TAUGATE_PICTURES"]) / name))


def prepare(page):
    page.browser.set_window_rect(0, 0, *WINDOW)
    page.until("document.getElementById('picture').dataset.revision")
    page.until("document.querySelector('#gate-preset [value=Median]') || document.querySelector('[value=many]').checked")


@pytest.mark.skipif("TAUGATE_PICTURES" not in os.environ, reason="makes pictures in the folder TAUGATE_PICTURES; tests nothing")
def test_pictures_of_one_gate_and_of_many():
    with view("--gate", "6.2m..6.5m", size=(512, 512)) as viewer, visit(viewer.url) as page:
        prepare(page)
        page.drag("#stage", (60, -20), (0, 0))
        take(page, "view.png", "0.03")
    with view("--gates", "20m..80m/30", scene="street.glb", size=(640, 360)) as viewer, visit(viewer.url) as page:
        prepare(page)
        page.click("[value=false]")
        # The gate with the car.
        handle = page.find("#gate-bin")
        handle.send_keys(Keys.HOME)
        for _ in range(22):
            handle.send_keys(Keys.RIGHT)
        page.drag("#stage", (60, 120), (0, 0))
        take(page, "view-gates.png", "0.03")
