"""A browser that shows the page, and the actions of a person in it."""

import contextlib
import io
import shutil
import time

import numpy as np
import pytest

from .program import PATIENCE, SIZE

pytest.importorskip("selenium")
image_reader = pytest.importorskip("matplotlib.image")

from selenium import webdriver
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

GLANCE = 0.05
# Seconds for a script of the tests.
SCRIPT_PATIENCE = 60
# Starts of chromedriver until one finds a port that no other program has.
STARTS = 20
SWITCHES = (
    "--headless",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    # WebGL2 without a graphics card.
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--force-device-scale-factor=1",
    "--window-size=1280,900",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
)


@contextlib.contextmanager
def visit(url):
    """A page in a browser whose tab shows `url`. The browser ends with the block. Skips the test where there is no browser."""
    with open_browser() as browser:
        browser.get(url)
        yield Page(browser)


def open_browser():
    # With both paths, Selenium downloads nothing.
    paths = {name: shutil.which(name) for name in ("chromium", "chromedriver")}
    for name, path in paths.items():
        if path is None:
            pytest.skip(f"there is no {name}; on Debian, apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = paths["chromium"]
    for switch in SWITCHES:
        options.add_argument(switch)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for _ in range(STARTS):
        try:
            browser = webdriver.Chrome(options=options, service=Service(executable_path=paths["chromedriver"]))
        except WebDriverException as error:
            # Another program took the port before chromedriver did.
            if "unexpectedly exited" not in str(error):
                raise
        else:
            browser.set_script_timeout(SCRIPT_PATIENCE)
            return browser
    pytest.fail("chromedriver does not start")


class Page:
    """The page in the current tab."""

    def __init__(self, browser):
        self.browser = browser

    def find(self, css):
        return self.browser.find_element(By.CSS_SELECTOR, css)

    def click(self, css):
        self.find(css).click()

    def text(self, css):
        return self.find(css).text

    def value(self, css):
        return self.find(css).get_property("value") or ""

    def enter(self, css, text):
        """Replaces the text of a field and presses Enter."""
        self.find(css).send_keys(Keys.CONTROL + "a")
        self.find(css).send_keys(text + Keys.ENTER)

    def press(self, keys):
        """Presses keys, wherever the focus is."""
        ActionChains(self.browser, duration=0).send_keys(keys).perform()

    def run(self, script):
        return self.browser.execute_script(script)

    def run_later(self, script, *arguments):
        """Runs a script that calls its last argument with the result."""
        return self.browser.execute_async_script(script, *arguments)

    def until(self, condition, patience=PATIENCE):
        """Waits until a JavaScript expression is true, for `patience` seconds at most."""
        start = time.monotonic()
        while self.run(f"return !!({condition})") is not True:
            if time.monotonic() - start > patience:
                text = self.run("return document.body.innerText")
                pytest.fail(f"this does not become true: {condition}\n{text}")
            time.sleep(GLANCE)

    def revision(self):
        """Number of the settings that the picture on the screen belongs to; 0 without a picture."""
        return self.run("return Number(document.getElementById('picture').dataset.revision ?? 0)")

    def picture_after(self, after, samples):
        """Waits for a picture of the whole image with at least this many samples per pixel, of later settings than `after`."""
        conditions = f"d.revision > {after} && d.size === '{SIZE}x{SIZE}' && d.samples >= {samples}"
        self.until(f"(d => {conditions})(document.getElementById('picture').dataset)")

    def pause(self):
        """Pauses, and waits until the picture on the screen is the last one."""
        self.click("#pause")
        self.until("document.getElementById('phase').textContent === 'Paused'")
        samples = "document.getElementById('samples').textContent.split(' ')[0]"
        self.until(f"document.getElementById('picture').dataset.samples === {samples}")

    def go_on(self):
        self.click("#pause")
        self.until("document.getElementById('phase').textContent !== 'Paused'")

    def save(self, viewer, name):
        """Saves the image as an EXR file. Returns its path."""
        self.enter("#save-name", name)
        self.until(f"document.getElementById('saved').textContent.includes('{name}.exr')")
        return viewer.folder / f"{name}.exr"

    def drag(self, css, start, by):
        """Presses the left button at a point of an element, given from its centre, moves it, and releases it."""
        chain = ActionChains(self.browser, duration=20)
        chain.move_to_element_with_offset(self.find(css), *start).click_and_hold()
        steps = 8
        # Divides as integers do in most languages: towards zero.
        place = [[int(whole * k / steps) for whole in by] for k in range(steps + 1)]
        for (x, y), (next_x, next_y) in zip(place, place[1:]):
            chain.move_by_offset(next_x - x, next_y - y)
        chain.release().perform()

    def says_nothing(self):
        """Fails if the browser's console has a message."""
        messages = [entry["message"] for entry in self.browser.get_log("browser")]
        assert not messages, f"the console has messages: {messages}"

    def screen(self):
        """The image on the screen as 8-bit R, G, B. One pixel of the image is one pixel of the screen."""
        self.click("#zoom-one")
        return self.shot()

    def shot(self):
        """The same without a click that draws the image again."""
        # After two frames of the screen, everything is drawn.
        self.run_later("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
        shot = image_reader.imread(io.BytesIO(self.find("#picture").screenshot_as_png), format="png")
        top, left = ((size - SIZE + 1) // 2 for size in shot.shape[:2])
        return np.rint(255 * shot[top : top + SIZE, left : left + SIZE, :3]).astype(np.uint8)
