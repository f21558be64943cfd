"""Cameras as matrices."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Optional, Union

import numpy as np
from numpy.typing import ArrayLike

from . import _lens
from ._errors import SettingsError

# Columns: the axes of OpenCV (x right, y down, z forward) in those of OpenGL (x right, y up, z backward).
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclasses.dataclass(frozen=True, eq=False)
class Camera:
    """A camera: where it stands, and what it sees.

    ``world_from_camera`` (4 x 4) has the axes of OpenCV: x to the right of the image, y down, z forward. ``world_from_camera_gl`` has those of
    OpenGL, Blender and glTF: y up, z backward. Lengths are in metres.

    ``resolution`` is (width, height) of the whole image. ``fov`` is the vertical field of view in degrees; an orthographic camera has the
    ``height`` of its view in metres instead. ``principal_point`` is where the optical axis meets the image, as fractions of width and
    height from the top left corner. ``crop`` (x0, x1, y0, y1) is the part that is rendered; ``None``: all. ``pixel_aspect`` is the width of
    a pixel over its height, ``K[1, 1] / K[0, 0]``. ``distortion`` has the coefficients of a lens in the order of OpenCV: k1, k2, p1, p2, then k3,
    then k4, k5, k6. With ``fisheye`` they are the four of ``cv2.fisheye``.

    ``aperture`` is the diameter of a thin lens in metres; ``None`` for a pinhole. It is in focus ``focus`` metres along the view. ``blades``
    makes it a regular polygon; 0: a disc. ``rays``, ``points`` and ``project`` belong to the centre of the lens.

    ``vignetting`` is the share of the light that reaches the sensor: ``None`` for all of it, ``"cos4"``, or an array (N, 2) of angles to the
    view in degrees, ascending from 0, and shares.
    """

    world_from_camera: np.ndarray
    resolution: tuple[int, int]
    fov: Optional[float] = None
    height: Optional[float] = None
    principal_point: tuple[float, float] = (0.5, 0.5)
    name: str = ""
    crop: Optional[tuple[int, int, int, int]] = None
    pixel_aspect: float = 1.0
    distortion: tuple[float, ...] = ()
    fisheye: bool = False
    aperture: Optional[float] = None
    focus: float = math.inf
    blades: int = 0
    vignetting: Optional[Union[str, np.ndarray]] = None

    @classmethod
    def look_at(
        cls,
        eye: ArrayLike,
        target: ArrayLike,
        up: ArrayLike = (0, 1, 0),
        fov: float = 40.0,
        resolution: Sequence[int] = (512, 512),
        height: Optional[float] = None,
    ) -> Camera:
        """A camera at ``eye`` that looks at the point ``target``. With ``height`` it is orthographic, and ``fov`` does not count."""
        eye, target, up = (np.asarray(x, float) for x in (eye, target, up))
        forward = target - eye
        right = np.cross(forward, up)
        if not np.linalg.norm(right) > 1e-9 * np.linalg.norm(forward) * np.linalg.norm(up) > 0:
            raise SettingsError("the camera needs a target that differs from its place, and an up that is not parallel to its view")
        forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
        matrix = np.eye(4)
        matrix[:3] = np.stack([right, np.cross(forward, right), forward, eye], axis=1)
        width, rows = resolution
        return cls(matrix, (width, rows), None if height else float(fov), height)

    @classmethod
    def from_matrices(
        cls,
        K: ArrayLike,
        world_from_camera: ArrayLike,
        resolution: Sequence[int],
        axes: str = "opencv",
        distortion: Optional[ArrayLike] = None,
        fisheye: bool = False,
    ) -> Camera:
        """A camera with the 3 x 3 matrix ``K`` of intrinsics and the pose ``world_from_camera`` (4 x 4, rigid).

        The centre of the first pixel is at (0.5, 0.5). OpenCV puts it at (0, 0): add 0.5 to its principal point. Pixels must have no skew.
        ``axes``: "opencv" or "opengl", the axes of the pose. ``distortion``: the coefficients of ``cv2.calibrateCamera``; with ``fisheye``,
        those of ``cv2.fisheye.calibrate``.
        """
        K, matrix = np.asarray(K, float), np.asarray(world_from_camera, float)
        if K.shape != (3, 3) or matrix.shape != (4, 4):
            raise SettingsError(f"K must be 3 x 3 and world_from_camera 4 x 4, not {K.shape} and {matrix.shape}")
        if axes not in ("opencv", "opengl"):
            raise SettingsError(f"axes is {axes!r}; choose 'opencv' or 'opengl'")
        if not (K[0, 0] > 0 and K[1, 1] > 0 and abs(K[0, 1]) <= 1e-6 * K[1, 1]):
            raise SettingsError("K needs positive focal lengths K[0, 0] and K[1, 1], and pixels without skew: K[0, 1] = 0")
        rotation = matrix[:3, :3]
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(rotation) < 0:
            raise SettingsError("the left 3 x 3 part of world_from_camera must be a rotation, without scale or mirror")
        width, height = resolution
        fov = math.degrees(2 * math.atan(height / (2 * K[1, 1])))
        pose = matrix @ FLIP if axes == "opengl" else matrix
        lens = tuple(np.ravel(distortion).astype(float).tolist()) if distortion is not None else ()
        return cls(pose, (width, height), fov, None, (K[0, 2] / width, K[1, 2] / height), "", None, K[1, 1] / K[0, 0], lens, fisheye)

    @classmethod
    def _of(cls, view):
        """The camera of a native view."""
        return cls(
            np.array(view.world_from_camera) @ FLIP,
            tuple(view.resolution),
            None if view.yfov is None else math.degrees(view.yfov),
            view.view_height,
            tuple(view.principal_point),
            view.name,
            tuple(view.crop),
            view.pixel_aspect,
            tuple(view.distortion),
            len(view.distortion) == 4,
            view.aperture,
            math.inf if view.focus is None else view.focus,
            view.blades,
            "cos4" if view.has_cos4 else np.array(view.vignetting) if view.vignetting else None,
        )

    @property
    def world_from_camera_gl(self) -> np.ndarray:
        """The pose with the axes of OpenGL, Blender and glTF."""
        return self.world_from_camera @ FLIP

    @property
    def camera_from_world(self) -> np.ndarray:
        """The extrinsics: the inverse of ``world_from_camera``."""
        return np.linalg.inv(self.world_from_camera)

    @property
    def K(self) -> np.ndarray:
        """Intrinsics (3 x 3) of the rendered part: pixel = K (x, y, z) / z, with the centre of its first pixel at (0.5, 0.5). A lens with
        ``distortion`` moves x / z and y / z before."""
        if self.fov is None:
            raise SettingsError("an orthographic or aimed camera has no matrix K; use a perspective camera")
        width, height = self.resolution
        focal = height / (2 * math.tan(math.radians(self.fov) / 2))
        x0, y0 = (self.crop[0], self.crop[2]) if self.crop else (0, 0)
        cx, cy = self.principal_point[0] * width - x0, self.principal_point[1] * height - y0
        return np.array([[focal / self.pixel_aspect, 0, cx], [0, focal, cy], [0, 0, 1.0]])

    def moved(self, right: float = 0.0, down: float = 0.0, forward: float = 0.0) -> Camera:
        """The same camera, moved along its own axes by these lengths in metres."""
        step = np.eye(4)
        step[:3, 3] = right, down, forward
        return dataclasses.replace(self, world_from_camera=self.world_from_camera @ step)

    def stereo(self, baseline: float) -> tuple[Camera, Camera]:
        """A rectified pair: this camera, and one ``baseline`` metres to its right. Disparity in pixels is ``K[0, 0] * baseline / z``."""
        return self, self.moved(right=baseline)

    def rays(self) -> np.ndarray:
        """Unit vectors (H, W, 3) in world space through the centres of the rendered pixels. Perspective cameras only."""
        width, height = self._size()
        K = self.K
        u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        image = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]], axis=-1)
        local = _lens.directions(image, self.distortion, self.fisheye)
        rays = local @ self.world_from_camera[:3, :3].T
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def points(self, depth: ArrayLike) -> np.ndarray:
        """World positions (H, W, 3) of a depth layer, which holds lengths of camera rays."""
        return self.world_from_camera[:3, 3] + np.asarray(depth, float)[..., None] * self.rays()

    def project(self, points: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (..., 2) of world positions (..., 3), and their z (...) in metres, which is negative behind the camera. The camera's own
        position gives NaN. Perspective cameras only."""
        local = np.asarray(points, float) @ self.camera_from_world[:3, :3].T + self.camera_from_world[:3, 3]
        image = _lens.images(local, self.distortion, self.fisheye)
        K = self.K
        return image * np.diag(K)[:2] + K[:2, 2], local[..., 2]

    def _size(self):
        x0, x1, y0, y1 = self.crop or (0, self.resolution[0], 0, self.resolution[1])
        return x1 - x0, y1 - y0

    def _settings(self):
        """The camera as settings of a render."""
        eye, forward, down = (self.world_from_camera[:3, k] for k in (3, 2, 1))
        if self.height is not None:
            view = {"ortho": self.height, "principal_point": tuple(self.principal_point)}
        elif self.distortion or self.pixel_aspect != 1.0:
            # The settings count pixels of the whole image, from the centre of the first one.
            K = dataclasses.replace(self, crop=None).K
            view = {"camera_matrix": (K[0, 0], K[1, 1], K[0, 2] - 0.5, K[1, 2] - 0.5)}
            if self.distortion:
                numbers = ",".join(repr(float(k)) for k in self.distortion)
                view["distortion"] = f"fisheye:{numbers}" if self.fisheye else numbers
        else:
            view = {"fov": self.fov, "principal_point": tuple(self.principal_point)}
        if self.aperture is not None:
            view |= {"aperture": self.aperture, "focus": self.focus, "blades": self.blades}
        if self.vignetting is not None:
            view["vignetting"] = self.vignetting
        if self.crop and tuple(self.crop) != (0, self.resolution[0], 0, self.resolution[1]):
            view["crop"] = tuple(self.crop)
        return {
            "look_from": tuple(eye),
            "look_at": tuple(eye + forward),
            "up": tuple(-down),
            "resolution": tuple(self.resolution),
            **view,
        }
