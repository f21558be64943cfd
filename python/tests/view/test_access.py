"""The page without a pointer and for screen readers, and its messages to the console."""

import os
import pathlib

import pytest

from .page import Keys, visit
from .program import view

# Describes an element: its id, else its tag and text. A group of radio buttons counts as one control, described by its name.
NAME = "const name = e => e.type === 'radio' ? `${e.name} (choice)` : e.id || `${e.tagName} ${e.textContent.trim()}`;"
CONTROLS = """return [...document.querySelectorAll('button, input, select, summary, [tabindex]')]
    .filter(e => e.checkVisibility() && !e.disabled).map(name)"""
NOTE = """window.reached = [];
    window.noted ??= (document.addEventListener('focusin', e => window.reached.push(name(e.target))), true)"""


def open_all(page):
    page.run("for (const part of document.querySelectorAll('details')) part.open = true")


def test_the_keyboard_reaches_every_control():
    with view("--gates", "5m..8m/12", "--spp", "2") as viewer, visit(viewer.url) as page:
        page.picture_after(0, 1)
        open_all(page)
        controls = set(page.run(NAME + CONTROLS))
        assert len(controls) > 50, controls
        reached = set()
        for _ in range(20):
            page.run(NAME + NOTE)
            page.press(6 * Keys.TAB)
            reached.update(page.run("return window.reached"))
        assert not controls - reached, f"the Tab key does not reach {controls - reached}"
        # Arrow keys choose within a group.
        page.find("[value=orbit]").send_keys(Keys.RIGHT)
        page.until("document.querySelector('[value=fly]').checked")
        page.says_nothing()


@pytest.mark.skipif(
    "TAUGATE_AXE" not in os.environ, reason="TAUGATE_AXE does not name the file axe.min.js of axe-core (npm pack axe-core)"
)
def test_axe_finds_no_fault():
    axe = pathlib.Path(os.environ["TAUGATE_AXE"]).read_text(encoding="utf-8")
    with view("--gate", "6.2m..6.5m", "--spp", "8") as viewer, visit(viewer.url) as page:
        page.picture_after(0, 4)
        page.run(axe)
        choices = [f"document.querySelector('[value={choice}]').click()" for choice in ("many", "error")]
        for prepare in ["return 0", *choices]:
            open_all(page)
            page.run(prepare)
            page.until("document.getElementById('phase').textContent === 'Done'")
            faults = "found.violations.map(v => v.id + ': ' + v.nodes.map(n => n.target))"
            assert page.run_later(f"axe.run(document).then(found => arguments[0]({faults}))") == [], f"after {prepare}"
        page.says_nothing()
