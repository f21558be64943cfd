"""taugate for Python: images and histograms of time-gated sensors as NumPy arrays.

    scene = taugate.load("room.glb")
    image = taugate.render(scene, gate="12.5m..12.8m", spp=64)
    image.show()

Lengths and travel times are in metres; the speed of light is 1. Importing the module needs no Vulkan; rendering does.
"""

from ._camera import Camera
from ._detect import Counts, detect
from ._errors import DeviceError, Error, FileError, Interrupted, NotFiniteError, SceneError, SettingsError
from ._image import Histogram, Image
from ._material import Material
from ._mitsuba import from_mitsuba
from ._native import VERSION as __version__
from ._render import Progress, histogram, render
from ._scan import Scan, scan
from ._scene import Scene, load
from ._texture import Texture
from ._words import settings

__all__ = [
    "Camera",
    "Counts",
    "DeviceError",
    "Error",
    "FileError",
    "Histogram",
    "Image",
    "Interrupted",
    "Material",
    "NotFiniteError",
    "Progress",
    "Scan",
    "Scene",
    "SceneError",
    "SettingsError",
    "Texture",
    "detect",
    "from_mitsuba",
    "histogram",
    "load",
    "render",
    "scan",
    "settings",
]
