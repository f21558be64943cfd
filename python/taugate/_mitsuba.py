"""Scenes of Mitsuba 3, read by Mitsuba itself."""

from __future__ import annotations

import dataclasses
import os
from typing import Any

import numpy as np

from ._errors import SettingsError
from ._material import Material
from ._mitsuba_bsdf import Materials
from ._mitsuba_light import Lights
from ._mitsuba_medium import Media
from ._mitsuba_sensor import Capture, Sensors
from ._mitsuba_shapes import SHAPES, fronts
from ._mitsuba_texture import Textures
from ._mitsuba_values import Notes, Values, kind_of, matrix_of
from ._scene import Scene

# Texture coordinates of the corners of a triangle whose mesh has none.
CORNERS = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])


def from_mitsuba(scene: Any, **settings: Any) -> Scene:
    """A :class:`Scene` from a scene of Mitsuba 3: the name of an XML file, a dictionary for ``mi.load_dict``, or an ``mi.Scene``.

    Needs the package ``mitsuba``, with a variant for RGB; without a variant it chooses ``llvm_ad_rgb`` or ``scalar_rgb``. Keyword arguments are
    settings of all renders. Where they do not say otherwise, the scene gets the gates of a film with travel times, and ``max_depth`` of its
    integrator. ``scene.not_converted`` of the result lists, in sentences, what is approximated or missing.

    Bitmaps and checkerboards become textures with 8 bits per channel: of the reflectance of diffuse, plastic and conducting surfaces, of the
    ``alpha`` of rough ones, of ``base_color``, ``roughness`` and ``metallic`` of the principled BSDF, and of the opacity of masks. Other
    textures become their mean, or grey.
    """
    try:
        import mitsuba as mi
    except ImportError:
        raise ImportError("from_mitsuba() needs Mitsuba 3: pip install mitsuba") from None
    if tuple(int(number) for number in mi.__version__.split(".")[:2]) < (3, 7):
        raise ImportError(f"from_mitsuba() needs Mitsuba 3.7 or newer, but this is {mi.__version__}: pip install -U mitsuba")
    if mi.variant() is None:
        mi.set_variant("llvm_ad_rgb", "scalar_rgb")
    if "rgb" not in mi.variant():
        raise SettingsError(f"the variant of Mitsuba is {mi.variant()}; choose one for RGB, such as mi.set_variant('llvm_ad_rgb')")
    # Without its optimizations, Mitsuba does not merge shapes, so each keeps its name.
    if isinstance(scene, (str, os.PathLike)):
        scene = mi.load_file(os.fspath(scene), optimize=False)
    elif isinstance(scene, dict):
        scene = mi.load_dict(scene, optimize=False)
    if not isinstance(scene, mi.Scene):
        kind = type(scene).__name__
        raise SettingsError(f"from_mitsuba() takes a scene, but this is a {kind}; put it into a dictionary of the type 'scene'")
    return _Reader(mi, settings).read(scene)


class _Reader(Values):
    def __init__(self, mi, settings):
        notes = Notes()
        super().__init__(mi, notes.add, Textures(mi, notes.add))
        self.given = settings
        self.scene = Scene(**settings)
        self.notes = notes
        #: Media in boxes: the name, the medium of Mitsuba, arguments of add_medium, two corners in the world.
        self.boxes = []
        #: Names of shapes and the media around them.
        self.outside = []
        self.materials, self.media, self.lights, self.sensors, self.capture = (
            kind(mi, self.note, self.textures) for kind in (Materials, Media, Lights, Sensors, Capture)
        )

    def read(self, scene):
        sensors, integrator = scene.sensors(), scene.integrator()
        settings = self.sensors.integrator_settings(integrator)
        captures = [sensor for sensor in sensors if kind_of(sensor) == "NLOSCaptureMeter"]
        #: The medium around the sensors. Mitsuba tells it from version 3.9 on.
        self.around = next(filter(None, (getattr(sensor, "get_medium", lambda: None)() for sensor in sensors)), None)
        if self.around is not None:
            self.surroundings(scene)
        for k, shape in enumerate(scene.shapes()):
            self.shape(shape, self.name(shape, f"shape-{k}"))
        self.add_boxes()
        if not captures:
            for k, emitter in enumerate(scene.emitters()):
                self.lights.add(self.scene, emitter, self.name(emitter, f"light-{k}"))
        for k, sensor in enumerate(sensors):
            name = self.name(sensor, f"camera-{k}")
            if captures and sensor is not captures[0]:
                self.note(f"the sensor '{name}' is left out, because the scene is a scan")
            elif captures:
                self.scene.scan = self.capture.table(scene, sensor, integrator)
            else:
                self.sensors.add(self.scene, sensor, name)
            if sensor is (captures or sensors)[0]:
                settings.update(self.sensors.film_settings(sensor, name))
        if any(self.given.get(key) is not None for key in ("gate", "gates", "depth", "response", "cw")):
            settings.pop("gates", None)
        self.scene.settings = {**settings, **self.scene.settings}
        self.scene.not_converted = list(self.notes)
        return self.scene

    def name(self, item, otherwise):
        """The id of an object; Mitsuba makes up ids that begin with an underscore."""
        name = item.id()
        return otherwise if not name or name.startswith("_") else name

    # Shapes.

    def surroundings(self, scene):
        """Adds the medium around the sensors, unless it is the one inside of a shape."""
        inside = [shape.interior_medium() for shape in scene.shapes()]
        if any(medium is not None and medium == self.around for medium in inside):
            self.around = None
        elif self.media.grid(self.around) is not None:
            self.note("the medium around the sensor, a density grid, is left out")
        else:
            medium = self.media.interior(self.around, "the surroundings")
            if medium is not None:
                self.scene.add_medium("surroundings", **medium)

    def shape(self, shape, name):
        geometry = self.triangles(shape, name)
        if geometry is None:
            return
        vertices, triangles, normals, uvs = geometry
        flipped, normals = fronts(self.mi, shape, vertices, triangles, normals)
        corners = np.where(flipped[:, None, None], CORNERS[::-1], CORNERS)
        triangles = np.where(flipped[:, None], triangles[:, ::-1], triangles)
        material = self.materials.material(shape.bsdf(), name, CORNERS if uvs is None else uvs)
        material = self.with_medium(shape, name, material, vertices, triangles)
        if material is None:
            return
        if not material._has_textures():
            uvs = None
        elif uvs is None:
            # Without texture coordinates, those of Mitsuba are barycentric.
            vertices, normals = vertices[triangles].reshape(-1, 3), None if normals is None else normals[triangles].reshape(-1, 3)
            triangles, uvs = np.arange(len(vertices)).reshape(-1, 3), corners.reshape(-1, 2)
        if shape.is_emitter():
            material = self.emissive(shape, name, material)
        # By name, so that add_material can replace it.
        self.scene.add_material(name, material)
        self.scene.add_mesh(name, vertices, triangles, name, normals=normals, uvs=uvs)

    def emissive(self, shape, name, material):
        """The material with the radiance of the emitter of the shape."""
        emitter, of = shape.emitter(), f"the emitter of '{name}'"
        if kind_of(emitter) != "AreaLight":
            self.note(f"{of}, of the type {kind_of(emitter)}, is left out")
            return material
        if material.double_sided:
            self.note(f"the back of the emitter '{name}' reflects no light")
        radiance = self.rgb(self.values(emitter), "radiance", of)
        return dataclasses.replace(material, emission=radiance, double_sided=False)

    def with_medium(self, shape, name, material, vertices, triangles):
        """The material with the medium inside of the shape. ``None``: the shape needs no mesh, because light passes it unchanged."""
        inside, outside = shape.interior_medium(), shape.exterior_medium()
        is_null = material.alpha == 0 and not material._has_textures()
        if outside is not None and outside != self.around:
            self.outside.append((name, outside))
        if is_null and shape.is_emitter():
            self.note(f"the emitter '{name}' is opaque")
            material = dataclasses.replace(material, alpha=1.0, color=(0.0, 0.0, 0.0))
        if inside is None:
            return None if is_null and not shape.is_emitter() else material
        if is_null and not shape.is_emitter():
            medium, interior = self.media.in_box(inside, name, vertices)
            if medium is not None:
                self.boxes.append((name, inside, medium, vertices.min(axis=0), vertices.max(axis=0)))
            elif interior is not None and not _is_closed(vertices, triangles):
                self.note(f"the medium of the shape '{name}' is left out, because the shape is not closed")
            elif interior is not None:
                return Material.glass(1.0, thin=False, interior=interior)
            return None
        if material.transmission > 0 and not material.thin:
            interior = None if self.media.grid(inside) is not None else self.media.interior(inside, name)
            if interior is not None:
                return dataclasses.replace(material, interior=interior)
        self.note(f"the medium of the shape '{name}' is left out")
        return material

    def add_boxes(self):
        """Adds the media in boxes. Where media overlap, the last one counts, so a box comes before the boxes inside of it."""
        self.boxes.sort(key=lambda box: -np.prod(box[4] - box[3]))
        for k, (name, _, medium, low, high) in enumerate(self.boxes):
            self.scene.add_medium(name, **medium)
            for other, _, _, other_low, other_high in self.boxes[:k]:
                is_inside = (low >= other_low).all() and (high <= other_high).all()
                if not is_inside and (low < other_high).all() and (high > other_low).all():
                    self.note(f"the media of '{other}' and '{name}' overlap; there, that of '{name}' counts")
        for name, outside in self.outside:
            if not any(inside == outside for _, inside, *_ in self.boxes):
                self.note(f"the medium outside of the shape '{name}' is left out")

    def triangles(self, shape, name):
        """Vertices in world space, triangles, normals or ``None``, and texture coordinates or ``None``; ``None`` if the shape is left out."""
        kind = shape.class_name()
        if kind in SHAPES:
            vertices, triangles, normals, uvs = SHAPES[kind]()
            matrix = matrix_of(self.values(shape)["to_world"])
            world = vertices @ matrix[:3, :3].T + matrix[:3, 3]
            if kind in ("Sphere", "Cylinder"):
                self.note(f"the {kind.lower()} '{name}' is a mesh of flat triangles with smooth normals")
            if np.linalg.det(matrix[:3, :3]) < 0:
                triangles = triangles[:, ::-1]
            if normals is not None:
                normals = normals @ np.linalg.inv(matrix[:3, :3])
                normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            return world, triangles, normals, uvs
        if not shape.is_mesh():
            self.note(f"the shape '{name}' of the type {kind} is left out")
            return None
        values = self.values(shape)
        vertices = np.array(values["vertex_positions"]).reshape(-1, 3)
        triangles = np.array(values["faces"]).reshape(-1, 3)
        normals = np.array(values.get("vertex_normals", [])).reshape(-1, 3)
        uvs = np.array(values.get("vertex_texcoords", [])).reshape(-1, 2)
        uvs = uvs if len(uvs) else None
        if not len(normals) or shape.has_face_normals():
            return vertices, triangles, None, uvs
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return vertices, triangles, normals / lengths if (lengths > 0).all() else None, uvs


def _is_closed(vertices, triangles):
    """Whether each edge belongs to two triangles, in opposite directions. Vertices at the same place count as one."""
    _, index = np.unique(np.asarray(vertices, np.float32) + np.float32(0), axis=0, return_inverse=True)
    corners = index.reshape(-1)[triangles]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    edges = edges[edges[:, 0] != edges[:, 1]]
    counts = {}
    for a, b in edges.tolist():
        key, step = ((a, b), 1) if a < b else ((b, a), -1)
        counts[key] = counts.get(key, 0) + step
    return not any(counts.values())
