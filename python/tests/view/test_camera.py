"""After the camera was turned on the page, the command on the page has the same camera."""

import math
import time

from .page import Keys, visit
from .program import agree, render, view

# JavaScript for the elevation of the camera in degrees. It looks at a point 1 m above the ground.
ELEVATION = """(([x, y, z]) => 180 / Math.PI * Math.atan2(y - 1, Math.hypot(x, z)))
    (document.getElementById('look-from').value.split(','))"""
COMMAND = "document.getElementById('command').textContent"
# After this time in seconds without a movement, the page follows the camera of the program.
SETTLED = 0.7


def numbers(text):
    x, y, z = map(float, text.split(","))
    return x, y, z


def test_the_camera_is_turned_moved_and_reset(tmp_path):
    with view("--gate", "6.2m..6.5m") as viewer, visit(viewer.url) as page:
        page.picture_after(0, 1)
        start = page.value("#look-from")
        before = page.revision()
        page.drag("#stage", (0, 0), (60, 20))
        page.picture_after(before, 1)
        page.until(f"{COMMAND}.includes('--look-from')")
        turned = page.value("#look-from")
        x, y, _ = numbers(turned)
        moves = "a drag to the right moves the camera to the left, a drag downwards moves it up"
        assert x < -0.5 and y > 1.1, f"{turned}: {moves}"

        # Waits for the full image, which comes after the previews.
        page.picture_after(page.revision() - 1, 32)
        page.until("/^[1-9][0-9]* % . [0-9]+ %$/.test(document.getElementById('device-share').textContent)")
        page.pause()
        saved = page.save(viewer, "turned")
        command = page.run(f"return {COMMAND}")
        # Removes the quotes, as a shell does.
        words = [word.replace("'", "") for word in command.split()]
        reference = render(tmp_path, *words[1 : words.index("--spp")])
        assert agree(saved, reference), f"the picture is not that of {command}"
        page.go_on()

        page.find("#stage").send_keys("r")
        page.until(f"document.getElementById('look-from').value === '{start}'")
        page.until(f"!{COMMAND}.includes('--look-from')")

        # Above 60 degrees, and at the largest elevation, the camera does not roll.
        page.drag("#stage", (0, -150), (0, 190))
        page.until(f"Math.abs({ELEVATION} - 65.3) < 1")
        time.sleep(SETTLED)
        before = page.run(f"return {ELEVATION}")
        page.drag("#stage", (-60, 0), (100, 0))
        page.until("document.getElementById('look-from').value.split(',')[0] < -0.5")
        time.sleep(SETTLED)
        after = page.run(f"return {ELEVATION}")
        assert abs(before - after) < 0.1, f"{before} and {after} degrees"
        page.drag("#stage", (0, -150), (0, 300))
        page.until(f"Math.abs({ELEVATION} - 88.85) < 0.1")
        # The default upward direction of such a view is +Z, so the command names +Y. The page follows the program, and turns as before.
        page.until(f"/--up '0(.0)?,1(.0)?,0(.0)?'/.test({COMMAND})")
        time.sleep(SETTLED)
        page.drag("#stage", (-60, 0), (100, 0))
        time.sleep(SETTLED)
        assert page.run(f"return Math.abs({ELEVATION} - 88.85) < 0.1 && /--up '0(.0)?,1(.0)?,0(.0)?'/.test({COMMAND})")
        page.drag("#stage", (0, 150), (0, -300))
        page.until(f"{ELEVATION} < 60 && !{COMMAND}.includes('--up')")
        page.find("#stage").send_keys("r")
        page.until(f"document.getElementById('look-from').value === '{start}'")

        # Flying forwards, then closer with the wheel's keys.
        page.find("#stage").send_keys("www")
        page.until("document.getElementById('look-from').value.split(',')[2] < 3.9")
        flown = numbers(page.value("#look-from"))[2]
        page.find("#stage").send_keys(Keys.PAGE_UP)
        page.until(f"document.getElementById('look-from').value.split(',')[2] < {flown} - 0.1")

        # Settings beside the picture.
        page.enter("#look-from", "0 1 3.5")
        page.enter("#max-depth", "5")
        page.find("#estimator").send_keys("bdpt")
        page.until(f"/--look-from '0.0,1.0,3.5'.*--estimator bdpt.*--max-depth 5/.test({COMMAND})")
        # A lens, which is in focus at the target at first.
        page.enter("#aperture", "20cm")
        page.until(f"/--aperture 0.2m --focus [0-9.]+/.test({COMMAND})")
        focus = float(page.value("#focus"))
        eye, target = (numbers(page.value(place)) for place in ("#look-from", "#look-at"))
        assert abs(focus - math.dist(eye, target)) < 0.01, focus
        page.enter("#focus", "2.5")
        page.until(f"{COMMAND}.includes('--focus 2.5')")
        page.enter("#focus", "0.1")
        page.until("document.querySelector('.alert.problem')?.textContent.includes('focus farther away')")
        page.until("document.getElementById('focus').value === '2.5'")
        page.enter("#aperture", Keys.DELETE)
        page.until(f"!{COMMAND}.includes('--aperture') && !{COMMAND}.includes('--focus')")

        page.enter("#max-depth", "-5")
        page.until("document.querySelector('.alert.problem')?.textContent.includes('max-depth')")
        page.until("document.getElementById('max-depth').value === '5'")
        page.says_nothing()
