"""Emitters of Mitsuba 3."""

from __future__ import annotations

import math
import re

import numpy as np

from ._mitsuba_values import Values, kind_of, matrix_of

# Most texels along an image of a sky, and points per texel along each side.
MAX_WIDTH = 2048
POINTS = 4
# Width of the image of a sky that Mitsuba computes.
WIDTH = 512
# Texels that are evaluated at a time.
PART = 1 << 16
SKIES = ("EnvironmentMapEmitter", "SunskyEmitter", "TimedSunskyEmitter", "ConstantBackgroundEmitter")


class Lights(Values):
    """Adds the emitters without a shape to a scene."""

    def add(self, scene, emitter, name):
        kind, values = kind_of(emitter), self.values(emitter)
        if kind == "AreaLight" or (kind not in SKIES and emitter.get_shape() is not None):
            # The shape has it.
            return
        if kind == "PointLight":
            position = np.array(values["position"], float).ravel()
            scene.add_light("point", name, position.tolist(), intensity=list(self.rgb(values, "intensity", f"'{name}'")))
        elif kind == "SpotLight" and "cutoff_angle" not in values:
            self.note(f"the spot '{name}' is left out; Mitsuba tells its angles from version 3.9 on")
        elif kind == "SpotLight":
            matrix = matrix_of(values["to_world"])
            outer, inner = (self.number(values, key) for key in ("cutoff_angle", "beam_width"))
            self.leave_out(values, "texture", f"the spot '{name}'")
            self.note(f"the light of the spot '{name}' falls off between its angles as in glTF, not linearly")
            scene.add_light(
                "spot", name, matrix[:3, 3].tolist(), direction=matrix[:3, 2].tolist(), inner_angle=inner, outer_angle=outer,
                intensity=list(self.rgb(values, "intensity", f"'{name}'")),
            )
        elif kind == "Projector":
            self.projector(scene, emitter, values, name)
        elif kind in SKIES:
            self.sky(scene, emitter, values, name, kind)
        elif kind == "DirectionalEmitter":
            self.note(f"the sun '{name}' is left out: scenes from arrays have no suns; put it into a glTF file, as KHR_lights_punctual")
        else:
            self.note(f"the emitter '{name}' of the type {kind} is left out")

    def projector(self, scene, emitter, values, name):
        """A spot with the power of the projector, and the solid angle of a cone with the same area in front of it."""
        matrix, power = matrix_of(values["to_world"]), projected_power(self, emitter, values, name)
        area = projected_area(emitter, values)
        half = math.atan(math.sqrt(area / math.pi))
        intensity = power / (2 * math.pi * (1 - math.cos(half)))
        self.note(f"the projector '{name}' becomes a spot with its power and a round cone, without a picture")
        scene.add_light(
            "spot", name, matrix[:3, 3].tolist(), direction=matrix[:3, 2].tolist(), intensity=intensity.tolist(),
            inner_angle=math.degrees(half), outer_angle=math.degrees(half),
        )

    def sky(self, scene, emitter, values, name, kind):
        """The setting `sky` of the scene. A scene of Mitsuba has at most one."""
        if "sky" in scene.settings:
            return
        if kind == "ConstantBackgroundEmitter":
            radiance = self.rgb(values, "radiance", f"'{name}'")
            if max(radiance) > 0:
                scene.settings = {**scene.settings, "sky": list(radiance)}
            return
        height, width = (np.array(values["data"]).shape[:2] if "data" in values else (WIDTH // 2, WIDTH))
        # A texel has one radiance, and Mitsuba interpolates. With twice the texels, the difference is smaller.
        scale = min(2.0, MAX_WIDTH / width)
        image = self.image(emitter, int(height * scale), int(width * scale))
        if kind != "EnvironmentMapEmitter":
            self.note(f"the sky '{name}' becomes an image of {image.shape[1]} x {image.shape[0]} texels, so its sun is as large as a texel")
        if not np.isfinite(image).all() or image.min() < 0:
            self.note(f"values of the sky '{name}' that are negative or not numbers become 0")
            image = np.where(np.isfinite(image), np.maximum(image, 0), 0)
        if image.max() > 0:
            scene.settings = {**scene.settings, "sky": image}

    def image(self, emitter, height, width):
        """The radiance (H, W, 3) of a sky as an equirectangular image of taugate: +Y is up, the centre is +X, and -Z is at a quarter."""
        points = 1 if self.mi.variant().startswith("scalar") else POINTS
        across = 2 * np.pi * ((np.arange(width * points) + 0.5) / (width * points) - 0.5)
        rows = []
        # In parts, so that memory stays small.
        for part in np.array_split(np.arange(height), -(-height * width // PART)):
            down = np.pi * (part[:, None] + (np.arange(points) + 0.5) / points).ravel() / height
            theta, phi = (x.ravel() for x in np.meshgrid(down, across, indexing="ij"))
            colors = self.radiance(emitter, np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], axis=1))
            # Texels near the poles are narrow at one edge.
            weights = np.sin(theta).reshape(-1, points, width, points, 1)
            sums = (colors.reshape(-1, points, width, points, 3) * weights).sum(axis=(1, 3))
            rows.append((sums / weights.sum(axis=(1, 3))).astype(np.float32))
        return np.concatenate(rows)

    def radiance(self, emitter, directions):
        """The radiance (N, 3) of a sky in these directions (N, 3), away from the scene."""
        import drjit as dr

        if self.mi.variant().startswith("scalar"):
            one, found = dr.zeros(self.mi.SurfaceInteraction3f), []
            for direction in directions:
                one.wi = self.mi.Vector3f((-direction).tolist())
                found.append(np.array(emitter.eval(one), float).ravel())
            return np.array(found)
        many = dr.zeros(self.mi.SurfaceInteraction3f, len(directions))
        many.wi = self.mi.Vector3f(*np.array(-directions.T, np.float32))
        color = emitter.eval(many)
        return np.stack([np.broadcast_to(np.array(color[k], float), len(directions)) for k in range(3)], axis=-1)


def projected_area(emitter, values):
    """Area of the picture of a projector at a distance of 1 m."""
    # Mitsuba tells the angle only in its text.
    text = re.search(r"x_fov = \[?([-+.\deE]+)", str(emitter)).group(1)
    width = 2 * math.tan(math.radians(float(text)) / 2)
    texels = np.array(values["irradiance.data"]).shape if "irradiance.data" in values else (1, 1)
    return width * width * texels[0] / texels[1]


def projected_power(reader, emitter, values, name):
    """Power of a projector in W, three numbers. Mitsuba multiplies the irradiance at 1 m by pi."""
    irradiance = np.array(reader.rgb(values, "irradiance", f"the projector '{name}'"))
    return math.pi * reader.number(values, "scale", 1.0) * irradiance * projected_area(emitter, values)
