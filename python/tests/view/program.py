"""`taugate view` as a process, and `taugate render` to compare with."""

import contextlib
import fcntl
import pathlib
import signal
import subprocess
import tempfile

from places import PROGRAM, SCENES

# Nothing on the page takes more seconds than this, even where the renderer and the browser share two cores.
PATIENCE = 20
# Width and height of all images of these tests.
SIZE = 32


def command(*words):
    assert PROGRAM.exists(), f"{PROGRAM} is not there; run cargo build --release first"
    return [str(word) for word in (PROGRAM, *words)]


class Viewer:
    """A running viewer."""

    def __init__(self, process, folder):
        self.process = process
        # For saved files.
        self.folder = pathlib.Path(folder)
        # The address that the viewer prints.
        self.url = process.stdout.readline().rstrip()
        assert self.url.startswith("http://127.0.0.1:"), f"taugate view prints its address first, not {self.url!r}"
        address, self.token = self.url.split("/#")
        self.port = int(address.rpartition(":")[2])

    def interrupt(self):
        """Ends the program as Ctrl-C does."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait()


@contextlib.contextmanager
def view(*flags, scene="cornell-box.glb", size=(SIZE, SIZE)):
    """Runs a viewer of a scene of the folder `scenes`. The viewer ends with the block.

    Viewers run one after the other: several would slow each other down. So each one locks this file. The tests may have several
    processes.
    """
    words = command("view", SCENES / scene, "--resolution", "{}x{}".format(*size), "--listen", "127.0.0.1:0", "--save-to")
    with open(__file__) as turn, tempfile.TemporaryDirectory() as folder:
        fcntl.flock(turn, fcntl.LOCK_EX)
        pipes = dict(stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        with subprocess.Popen([*words, folder, *flags], **pipes) as process:
            try:
                yield Viewer(process, folder)
            finally:
                process.kill()


def render(folder, *words):
    """Renders with the words of a command line after `taugate`, with another seed than the page. Returns the image's path."""
    image = pathlib.Path(tempfile.mkdtemp(dir=folder)) / "image.exr"
    words = command(*words, "--seed", 7, "--spp", 32, "--quiet", "-o", image)
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, f"{words}: {done.stderr}"
    return image


def render_box(folder, *flags):
    """Renders the Cornell box with the size of these tests."""
    return render(folder, "render", SCENES / "cornell-box.glb", "--resolution", f"{SIZE}x{SIZE}", *flags)


def agree(a, b):
    """Whether two images agree within their noise, as `taugate compare --z` decides."""
    with tempfile.TemporaryDirectory() as folder:
        words = command("compare", a, b, "--z", pathlib.Path(folder) / "z.png")
        done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stderr
    return done.returncode == 0
