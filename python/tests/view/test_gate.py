"""The gate: dragged, typed and played."""

import time

from .page import Keys, visit
from .program import agree, render_box, view
from .relay import Relay


def fields(page):
    """The gate in the fields, in metres."""
    return [float(page.value("#gate-from")), float(page.value("#gate-to"))]


def test_the_gate_that_is_dragged_is_rendered(tmp_path):
    with view("--gate", "6.2m..6.5m") as viewer, visit(viewer.url) as page:
        page.picture_after(0, 1)
        # The time line has its range when the light has been measured.
        page.until("document.querySelector('#gate-preset [value=Median]')")
        before = page.revision()
        page.drag("#gate-window", (0, 10), (90, 0))
        page.picture_after(before, 32)
        begin, end = fields(page)
        assert begin > 6.5 and abs(end - begin - 0.3) < 1e-6
        page.pause()
        saved = page.save(viewer, "dragged")
        reference = render_box(tmp_path, "--gate", f"{begin}m..{end}m")
        assert agree(saved, reference), f"the picture is not that of the gate {begin}..{end}"
        page.go_on()

        # One end, by pointer and by keyboard.
        page.drag("#gate-end", (-8, 0), (40, 0))
        page.until(f"Number(document.getElementById('gate-to').value) > {end} + 0.1")
        assert fields(page)[0] == begin
        page.find("#gate-begin").send_keys(2 * Keys.RIGHT)
        page.until(f"Number(document.getElementById('gate-from').value) > {begin}")
        narrower = fields(page)
        page.find("#gate-window").send_keys(Keys.PAGE_UP)
        width = narrower[1] - narrower[0]
        page.until(f"Math.abs(document.getElementById('gate-from').value - {narrower[0] + width}) < 0.05")
        page.says_nothing()


def test_presets_set_both_ends_of_the_gate():
    with view("--gate", "6.2m..6.5m", "--spp", "4") as viewer, visit(viewer.url) as page:
        page.picture_after(0, 1)
        page.until("document.querySelector('#gate-preset [value=Median]')")
        page.until("document.getElementById('gate-preset').value === 'As at the start'")
        preset = page.find("#gate-preset")
        gates = []
        for key, name in ((Keys.HOME, "First light"), (Keys.DOWN, "Median"), (Keys.DOWN, "Late light")):
            before = page.revision()
            preset.send_keys(key)
            page.picture_after(before, 1)
            page.until(f"document.getElementById('gate-preset').value === '{name}'")
            gates.append(fields(page))
        assert all(a[0] < b[0] and a[1] < b[1] for a, b in zip(gates, gates[1:])), gates
        # Another gate is no preset.
        page.enter("#gate-to", "20")
        page.until("document.getElementById('gate-preset').value === ''")
        preset.send_keys(Keys.END)
        page.until("document.getElementById('gate-to').value === '6.5'")
        assert fields(page) == [6.2, 6.5]
        page.says_nothing()


def test_named_responses_are_presets_without_a_new_render():
    responses = ("--response", "near=box:5m..6m", "--response", "far=gauss:8m..9m,0.1m")
    with view(*responses, "--spp", "4") as viewer, visit(viewer.url) as page:
        page.picture_after(0, 1)
        revision = page.revision()
        for key, number in ((Keys.END, 1), (Keys.HOME, 0)):
            page.find("#gate-preset").send_keys(key)
            page.until(f"document.getElementById('picture').dataset.response === '{number}'")
        assert page.revision() == revision
        page.says_nothing()


def test_the_gate_is_typed_in_all_units():
    with view("--gate", "6.2m..6.5m", "--spp", "4") as viewer, visit(viewer.url) as page:
        page.picture_after(0, 1)
        page.enter("#gate-from", "20ns")
        page.until("document.getElementById('command').textContent.includes('--gate 5.995')")
        page.find("#gate-unit").send_keys("n")
        page.until("document.getElementById('gate-unit').value === 'ns'")
        page.enter("#gate-to", "22")
        page.until("document.getElementById('command').textContent.includes('--gate 5.99584916m..6.595434076m')")
        page.find("#gate-unit").send_keys("m d")
        page.until("document.getElementById('gate-unit').value === 'depth'")
        page.enter("#gate-from", "3.1")
        page.enter("#gate-width", "0.1")
        page.until("document.getElementById('command').textContent.includes('--depth 3.1m..3.2m')")

        # A mistake is one sentence, and changes nothing.
        page.enter("#gate-from", "soon")
        page.until("document.querySelector('.alert.problem')?.textContent.includes('soon')")
        assert page.value("#gate-from") == "3.1"

        page.click("[value=steady]")
        page.until("!/--(gate|depth)/.test(document.getElementById('command').textContent)")
        before = page.revision()
        page.click("[value=gate]")
        page.until("document.getElementById('command').textContent.includes('3.1m..3.2m')")
        page.picture_after(before, 1)

        # Playing moves the gate.
        page.click("#gate-play")
        page.until("Number(document.getElementById('gate-from').value) > 3.18")
        page.click("#gate-play")
        # Behind the last light, playing begins again with the first light.
        page.enter("#gate-to", "200")
        page.enter("#gate-from", "199.9")
        page.click("#gate-play")
        page.until("Number(document.getElementById('gate-from').value) < 10")
        page.click("#gate-play")

        # A gate without end gets one from the end of the range, also if the key comes before the next frame of the screen.
        page.run(
            """const to = document.getElementById('gate-to');
            to.value = 'inf';
            to.dispatchEvent(new Event('change', { bubbles: true }));
            document.getElementById('gate-end').dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowLeft', bubbles: true }))"""
        )
        page.until("Number(document.getElementById('gate-to').value) < 200")

        # The time line has a finest scale.
        page.run(
            """const handle = document.getElementById('gate-begin');
            for (let k = 0; k < 300; k++) handle.dispatchEvent(new KeyboardEvent('keydown', { key: '+', bubbles: true }))"""
        )
        page.click("#track-all")
        page.until("document.getElementById('gate-begin').getAttribute('aria-valuemax') > 5")
        page.says_nothing()


def test_many_gates_are_scrubbed_without_a_new_render():
    with view("--gates", "5m..8m/12", "--spp", "4") as viewer, visit(viewer.url) as page:
        page.picture_after(0, 1)
        page.until("document.getElementById('picture').dataset.response > 0")
        revision = page.revision()
        handle = page.find("#gate-bin")
        handle.send_keys(Keys.HOME)
        page.until("document.getElementById('picture').dataset.response === '0'")
        handle.send_keys(3 * Keys.RIGHT)
        page.until("document.getElementById('picture').dataset.response === '3'")
        assert page.text("#gate-text").startswith("bin03 of bin00 to bin11: 5.75–6 m")
        page.drag("#gate-bin", (0, 0), (0, 0))
        page.click("#gate-play")
        page.until("document.getElementById('picture').dataset.response > 6")
        page.click("#gate-play")
        assert page.revision() == revision
        page.says_nothing()


def test_a_late_answer_does_not_reset_the_gate():
    """Answers arrive 1.5 s late. The answer to one end of the gate arrives after the user has typed the other end."""
    with view("--gate", "6.2m..6.5m") as viewer:
        relay = Relay(viewer.port, delay=1.5)
        with visit(f"http://localhost:{relay.port}/#{viewer.token}") as page:
            page.picture_after(0, 1)
            page.enter("#gate-from", "7")
            time.sleep(1.3)
            page.enter("#gate-to", "8")
            start = time.monotonic()
            while time.monotonic() - start < 1.4:
                assert fields(page) == [7.0, 8.0]
            page.until("document.getElementById('command').textContent.includes('--gate 7m..8m')")
            page.says_nothing()
