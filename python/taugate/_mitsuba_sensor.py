"""Sensors, films and integrators of Mitsuba 3."""

from __future__ import annotations

import math
import re

import numpy as np

from ._camera import Camera
from ._errors import SceneError
from ._mitsuba_values import Values, kind_of, matrix_of

# Mitsuba's default for near_clip, in metres. Larger values are meant to hide something.
NEAR = 0.01
# Largest number of segments of a path in taugate; Mitsuba writes "no limit" as -1.
MAX_DEPTH = 254
# Switches of integrators that change the image.
SWITCHES = ("camera_unwarp", "discard_direct_light", "discard_direct_paths", "hide_emitters", "skip_area_emitters")
CAMERAS = ("PerspectiveCamera", "ThinLensCamera", "OrthographicCamera")


class Sensors(Values):
    """Adds sensors to a scene, and finds the settings of films and integrators."""

    def add(self, scene, sensor, name):
        kind, values = kind_of(sensor), self.values(sensor)
        if kind not in CAMERAS:
            self.note(f"the sensor '{name}' of the type {kind} is left out")
            return
        matrix, near = matrix_of(values["to_world"]), self.number(values, "near_clip", NEAR)
        width, height = (int(x) for x in np.array(values["film.size"]).ravel())
        columns, rows = (int(x) for x in np.array(values["film.crop_size"]).ravel())
        left, top = (int(x) for x in np.array(values.get("film.crop_offset", (0, 0))).ravel())
        crop = None if (columns, rows) == (width, height) else (left, left + columns, top, top + rows)
        lengths = np.linalg.norm(matrix[:3, :3], axis=0)
        # Mitsuba's cameras look along +Z, with +X to the left and +Y up.
        pose = np.eye(4)
        pose[:3, :3] = matrix[:3, :3] / lengths * (-1, -1, 1)
        pose[:3, 3] = matrix[:3, 3]
        if np.linalg.det(pose[:3, :3]) < 0:
            raise SceneError(f"the sensor '{name}' mirrors its image; remove the mirror from its transform")
        if kind == "OrthographicCamera":
            if abs(lengths[0] - lengths[1]) > 1e-4 * lengths[0]:
                self.note(f"the pixels of the sensor '{name}' become squares")
            # Its rays start on the near plane.
            pose[:3, 3] += near * matrix[:3, 2]
            view = {"height": 2 * lengths[0] * height / width}
        else:
            if near > NEAR:
                self.note(f"near_clip of the sensor '{name}' is left out")
            half = math.tan(math.radians(self.number(values, "x_fov")) / 2) * height / width
            offsets = [self.number(values, f"principal_point_offset_{axis}") for axis in "xy"]
            view = {"fov": math.degrees(2 * math.atan(half)), "principal_point": tuple(0.5 - offset for offset in offsets)}
            if kind == "ThinLensCamera":
                view |= {"aperture": 2 * self.number(values, "aperture_radius"), "focus": self.number(values, "focus_distance")}
        filter = kind_of(sensor.film().rfilter())
        if filter != "BoxFilter":
            self.note(f"the filter of the sensor '{name}', a {filter}, becomes a box of one pixel")
        scene.add_camera(name, Camera(pose, (width, height), name=name, crop=crop, **view))

    def film_settings(self, sensor, name):
        """The gates of a film with travel times."""
        film = sensor.film()
        keys = ("start_opl", "bin_width_opl", "temporal_bins")
        if not all(hasattr(film, key) for key in keys):
            if not kind_of(film).endswith("HDRFilm") or kind_of(film) not in ("HDRFilm", "TransientHDRFilm"):
                self.note(f"the film of the sensor '{name}', a {kind_of(film)}, becomes an image")
            return {}
        start, width, count = (float(np.array(getattr(film, key)).ravel()[0]) for key in keys)
        if kind_of(film) != "TransientHDRFilm":
            self.note(f"the film of the sensor '{name}', a {kind_of(film)}, becomes a histogram")
        near = self.number(self.values(sensor), "near_clip")
        if kind_of(sensor) == "PerspectiveCamera" and near > 0.1 * width:
            self.note(f"travel times to the sensor '{name}' are up to {near:g} m longer than in Mitsuba, which measures them from its near_clip")
        return {"gates": (start, start + width * count, int(count))}

    def integrator_settings(self, integrator):
        """The settings of an integrator. ``None`` has none."""
        if integrator is None:
            return {}
        kind = kind_of(integrator)
        for key in SWITCHES:
            if getattr(integrator, key, False) is True or re.search(rf"\b{key} = (true|1)\b", str(integrator)):
                self.note(f"{key} of the integrator is left out")
        for key in ("filter_depth", "filter_bounces"):
            if getattr(integrator, key, -1) != -1:
                self.note(f"{key} of the integrator is left out")
                break
        depth = getattr(integrator, "max_depth", None)
        if depth is None:
            # Integrators of Mitsuba itself tell it only in their text.
            found = re.search(r"\bmax_depth = (-?\d+)", str(integrator))
            depth = found and int(found.group(1))
        if kind == "DirectIntegrator":
            depth = 2
        if depth is None:
            return {}
        depth = int(np.array(depth).ravel()[0])
        if depth == 0:
            self.note("max_depth of the integrator is 0, which gives a black image; it becomes 1, light that comes straight from emitters")
            return {"max_depth": 1}
        return {"max_depth": depth if 0 < depth <= MAX_DEPTH else MAX_DEPTH}


class Capture(Values):
    """The table ``[scan]`` of a capture around a corner (``nlos_capture_meter`` of mitransient)."""

    def table(self, scene, sensor, integrator):
        """The table, and the settings of its film. `scene`: of Mitsuba."""
        wall, film = sensor.get_shape(), sensor.film()
        columns, rows = (int(x) for x in np.array(film.size()).ravel())
        emitters = [emitter for emitter in scene.emitters()]
        if len(emitters) != 1 or kind_of(emitters[0]) != "Projector":
            raise SceneError(
                "a capture with nlos_capture_meter needs one projector as its laser, and no other emitter; remove the others"
            )
        laser = matrix_of(emitters[0].world_transform())
        place, axis = laser[:3, 3], laser[:3, 2] / np.linalg.norm(laser[:3, 2])
        sensor_place = matrix_of(sensor.world_transform())[:3, 3]
        kind = getattr(getattr(integrator, "capture_type", None), "name", "Single").lower()
        table = {"laser": place.tolist(), "sensor": sensor_place.tolist()}
        if getattr(sensor, "is_confocal", False):
            lit = np.array(sensor.laser_target, float).reshape(1, 3)
            table["points"] = lit.tolist()
        elif kind == "confocal":
            table["points"], lit = self.points(wall, columns, rows)
        elif kind == "exhaustive":
            if not getattr(integrator, "force_equal_grids", True):
                self.note("the grid of the laser is that of the sensor: force_equal_illumination_scanning=False is left out")
            table["laser_points"], lit = self.points(wall, columns, rows)
            table["sensor_points"] = table["laser_points"]
        else:
            lit = self.hit(scene, place, axis)
            table["laser_points"] = lit.tolist()
            table["sensor_points"], _ = self.points(wall, columns, rows)
        table["account_first_and_last_bounces"] = bool(getattr(integrator, "account_first_and_last_bounces", False))
        table["power"] = self.power(wall, emitters[0], place, lit, integrator)
        return table

    def points(self, wall, columns, rows):
        """The points of a grid on the wall, as in a table ``[scan]``, and their positions (N, 3), row by row."""
        u, v = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
        found = np.array([self.place(wall, *uv) for uv in zip(u.ravel(), v.ravel())])
        corner, right, bottom = (self.place(wall, *uv) for uv in ((0, 0), (1, 0), (0, 1)))
        flat = corner + u.reshape(-1, 1) * (right - corner) + v.reshape(-1, 1) * (bottom - corner)
        if np.abs(flat - found).max() > 1e-5 * np.abs(right - corner).max():
            return found.tolist(), found
        grid = {"corner": corner, "across": right - corner, "down": bottom - corner}
        return {**{key: value.tolist() for key, value in grid.items()}, "count": [columns, rows]}, found

    def place(self, wall, u, v):
        return np.array(wall.sample_position(0, self.mi.Point2f(float(u), float(v))).p, float).reshape(3)

    def hit(self, scene, place, axis):
        """The point (1, 3) that the laser lights."""
        ray = self.mi.Ray3f(self.mi.Point3f(place.tolist()), self.mi.Vector3f(axis.tolist()))
        found = scene.ray_intersect(ray)
        if not np.isfinite(np.array(found.t).ravel()).all():
            raise SceneError("the laser of the capture does not point at the scene; turn its to_world towards the wall")
        return np.array(found.p, float).reshape(1, 3)

    def power(self, wall, projector, place, lit, integrator):
        """Power of the laser in W: what mitransient's laser sends onto 1 m² around its point, because it takes the point for such an area."""
        values = self.values(projector)
        irradiance = np.mean(self.rgb(values, "irradiance", "the laser"))
        intensity = math.pi * self.number(values, "scale", 1.0) * irradiance
        towards = place - lit
        distance = np.linalg.norm(towards, axis=1)
        normal = np.array(wall.sample_position(0, self.mi.Point2f(0.5, 0.5)).n, float).reshape(3)
        powers = intensity * np.abs(towards @ normal) / distance**3
        if powers.max() > 1.001 * powers.min():
            self.note("the laser of the capture has the same power at all points, the mean of mitransient's, which falls with the distance")
        if not getattr(integrator, "laser_sampling", False):
            self.note("the power of the laser is that of mitransient with nlos_laser_sampling")
        return float(powers.mean())
