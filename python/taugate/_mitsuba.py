"""Scenes of Mitsuba 3, read by Mitsuba itself."""

from __future__ import annotations

import dataclasses
import math
import os
from typing import Any

import numpy as np

from ._camera import Camera
from ._errors import SceneError, SettingsError
from ._material import Material
from ._mitsuba_shapes import SHAPES
from ._mitsuba_texture import LUMINANCE, Notes, Textures, children, mix_root
from ._scene import Scene

# Mitsuba's default for near_clip, in metres. Larger values are meant to hide something.
NEAR = 0.01
# Texture coordinates of the corners of a triangle whose mesh has none.
CORNERS = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
KINDS = (
    "Principled", "SmoothDiffuse", "SmoothPlastic", "RoughPlastic", "SmoothConductor", "RoughConductor", "SmoothDielectric", "RoughDielectric",
)
# BSDFs around another one, and their names.
WRAPPERS = {"TwoSidedBRDF": "two-sided BSDF", "MaskBSDF": "mask", "BumpMap": "bump map", "NormalMap": "normal map"}


def from_mitsuba(scene: Any, **settings: Any) -> Scene:
    """A :class:`Scene` from a scene of Mitsuba 3: the name of an XML file, a dictionary for ``mi.load_dict``, or an ``mi.Scene``.

    Needs the package ``mitsuba``, with a variant for RGB; without a variant it chooses ``llvm_ad_rgb`` or ``scalar_rgb``. Keyword arguments are
    settings of all renders. ``scene.not_converted`` of the result lists, in sentences, what is approximated or missing.

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
    if isinstance(scene, (str, os.PathLike)):
        scene = mi.load_file(os.fspath(scene))
    elif isinstance(scene, dict):
        scene = mi.load_dict(scene)
    return _Reader(mi, settings).read(scene)


class _Reader:
    def __init__(self, mi, settings):
        self.mi = mi
        self.scene = Scene(**settings)
        self.notes = Notes()
        self.note = self.notes.add
        self.textures = Textures(mi, self.note)

    def read(self, scene):
        for k, shape in enumerate(scene.shapes()):
            self.shape(shape, self.name(shape, f"shape-{k}"))
        for k, emitter in enumerate(scene.emitters()):
            self.emitter(emitter, self.name(emitter, f"light-{k}"))
        for k, sensor in enumerate(scene.sensors()):
            self.sensor(sensor, self.name(sensor, f"camera-{k}"))
        self.scene.not_converted = list(self.notes)
        return self.scene

    def name(self, item, otherwise):
        """The id of an object; Mitsuba makes up ids that begin with an underscore."""
        name = item.id()
        return otherwise if not name or name.startswith("_") else name

    def values(self, item):
        """The parameters of an object and of its nested objects, by name. Textures have the name of the parameter that they are."""
        found = self.mi.traverse(item)
        values = {key: found[key] for key in found.keys()}
        for name, child in children(self.mi, item).items():
            if isinstance(child, self.mi.Texture):
                values[name] = child
                values.update({f"{name}.{key}": value for key, value in self.values(child).items()})
        return values

    # Shapes.

    def shape(self, shape, name):
        geometry = self.triangles(shape, name)
        if geometry is None:
            return
        vertices, triangles, normals, uvs = geometry
        corners = CORNERS
        if self.is_flipped(shape, vertices, triangles):
            triangles, corners, normals = triangles[:, ::-1], CORNERS[::-1], None if normals is None else -normals
        material = self.material(shape.bsdf(), name, CORNERS if uvs is None else uvs)
        if not material._has_textures():
            uvs = None
        elif uvs is None:
            # Without texture coordinates, those of Mitsuba are barycentric.
            vertices, normals = vertices[triangles].reshape(-1, 3), None if normals is None else normals[triangles].reshape(-1, 3)
            triangles, uvs = np.arange(len(vertices)).reshape(-1, 3), np.tile(corners, (len(triangles), 1))
        if shape.is_emitter():
            if material.double_sided:
                self.note(f"the back of the emitter '{name}' reflects no light")
            radiance = self.rgb(self.values(shape.emitter()), "radiance", f"the emitter of '{name}'")
            material = dataclasses.replace(material, emission=radiance, double_sided=False)
        if shape.interior_medium() is not None or shape.exterior_medium() is not None:
            self.note(f"the medium of the shape '{name}' is left out")
        # By name, so that add_material can replace it.
        self.scene.add_material(name, material)
        self.scene.add_mesh(name, vertices, triangles, name, normals=normals, uvs=uvs)

    def triangles(self, shape, name):
        """Vertices in world space, triangles, normals or ``None``, and texture coordinates or ``None``; ``None`` for a shape that is left out."""
        kind = shape.class_name()
        if kind in SHAPES:
            vertices, triangles, normals, uvs = SHAPES[kind]()
            matrix = _matrix(self.values(shape)["to_world"])
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

    def is_flipped(self, shape, vertices, triangles):
        """Whether the front of the shape is the back of the triangles."""
        sample = shape.sample_position(0, self.mi.Point2f(0.3, 0.4))
        point, normal = (np.array(value, float).reshape(3) for value in (sample.p, sample.n))
        corners = vertices[triangles].astype(float)
        crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(crosses, axis=1)
        # Triangles without area have no front.
        corners, crosses = corners[lengths > 0], crosses[lengths > 0] / lengths[lengths > 0, None]
        if not len(corners):
            return False
        # Finds the triangle of the point: its plane contains the point, and among such triangles its centre is the nearest.
        offset = point - corners.mean(axis=1)
        size = np.abs(corners - corners.mean(axis=1, keepdims=True)).max()
        distance = np.abs((offset * crosses).sum(axis=1)) / size + 1e-3 * np.linalg.norm(offset, axis=1) / size
        return crosses[distance.argmin()] @ normal < 0

    # Materials.

    def material(self, bsdf, name, uvs):
        of = f"the BSDF of '{name}'"
        opacity, holes, is_twosided = 1.0, None, False
        while bsdf.class_name() in WRAPPERS:
            kind = bsdf.class_name()
            is_twosided |= kind == "TwoSidedBRDF"
            if kind == "MaskBSDF":
                values = self.values(bsdf)
                if holes is None and self.convertible(values, "opacity") is not None:
                    holes = values
                else:
                    opacity *= self.share(values, "opacity", of)
            elif kind != "TwoSidedBRDF":
                self.note(f"the {WRAPPERS[kind]} of {of} is left out")
            # The first BSDF in a two-sided BSDF is its front.
            bsdf, *others = (child for child in children(self.mi, bsdf).values() if isinstance(child, self.mi.BSDF))
            if any(other is not bsdf for other in others):
                self.note(f"the back of {of} is like its front")
        material = self.inner_material(bsdf, name, uvs, is_twosided)
        if holes is not None:
            texture = self.textures.with_alpha(material.texture, holes["opacity"], f"the texture opacity of {of}", uvs)
            if texture is None:
                opacity *= self.share(holes, "opacity", of)
            else:
                material = dataclasses.replace(material, texture=texture)
        return dataclasses.replace(material, alpha=opacity)

    def inner_material(self, bsdf, name, uvs, is_twosided):
        """The material of a BSDF that is not around another one."""
        of, kind = f"the BSDF of '{name}'", bsdf.class_name()
        if kind not in KINDS:
            self.note(f"the BSDF {kind} of '{name}' becomes grey and diffuse")
            return Material.diffuse(0.5)
        values = self.values(bsdf)
        sides = {"double_sided": is_twosided}
        if kind == "Principled":
            return self.principled(values, of, uvs, sides)
        roughness, sides["roughness_texture"] = self.roughness(values, of, uvs) if kind.startswith("Rough") else (0.0, None)
        if "distribution = beckmann" in str(bsdf).lower():
            self.note(f"the microfacets of '{name}' are GGX instead of Beckmann")
        if kind == "SmoothDiffuse":
            color, texture = self.color(values, "reflectance", of, uvs)
            return Material.diffuse(color, texture=texture, double_sided=is_twosided)
        if kind.endswith("Plastic"):
            self.note(f"the plastic of '{name}' has the coat of glTF, which differs by some percent")
            self.leave_out(values, "specular_reflectance", of)
            color, texture = self.color(values, "diffuse_reflectance", of, uvs)
            return Material.plastic(color, roughness, ior=self.mean(values, "eta", 1.49, of), texture=texture, **sides)
        if kind.endswith("Conductor"):
            self.note(f"the conductor of '{name}' has its reflectance at normal incidence, and Schlick's rise towards grazing angles")
            eta, k = (np.array(self.rgb(values, key, of)) for key in ("eta", "k"))
            color, texture = ((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2), None
            if any(key.startswith("specular_reflectance") for key in values):
                factor, texture = self.color(values, "specular_reflectance", of, uvs)
                color = color * np.array(factor)
            return Material.metal(tuple(np.clip(color, 0, 1)), roughness, texture=texture, **sides)
        for key in ("specular_reflectance", "specular_transmittance"):
            self.leave_out(values, key, of)
        eta = self.mean(values, "eta", 1.5, of)
        if eta < 1:
            self.note(f"the dielectric of '{name}' has an index below 1, so its inside counts as vacuum")
        return Material.glass(max(eta, 1.0), roughness, roughness_texture=sides["roughness_texture"])

    def principled(self, values, of, uvs, sides):
        """The material of the principled BSDF. Its roughness is that of glTF: the square root of the alpha of GGX."""
        for key in ("anisotropic", "sheen", "flatness"):
            self.leave_out(values, key, of, 0.0)
        if "eta" in values:
            eta = self.mean(values, "eta", 1.5, of)
        else:
            eta = 2 / (1 - math.sqrt(0.08 * self.share(values, "specular", of))) - 1
        if eta < 1:
            self.note(f"eta of {of} is below 1; it becomes 1")
        surface = self.surface(values, of, uvs)
        metallic = surface["metallic"] if "metallic_texture" not in surface else float(self.textures.mean(values["metallic"]) @ LUMINANCE)
        if eta == 1 and metallic > 0:
            self.note(f"the metal of {of} reflects light; in Mitsuba it is black, because its specular is 0")
        transmission = self.share(values, "spec_trans", of) if metallic < 1 else 0.0
        if metallic < 1 and transmission < 1:
            self.note(f"the diffuse part of {of} is that of glTF; its albedo is from 9 % lower to 5 % higher")
        # Light through Mitsuba's glass gets the square root of the base colour, because it passes two surfaces.
        root = transmission * (1 - metallic)
        if 0 < root < 1:
            self.note(f"base_color of {of} becomes a mix of itself and its square root, which is the colour of the glass")
        color, texture = self.color(values, "base_color", of, uvs, root)
        specular_color, tint, clearcoat = np.ones(3), self.share(values, "spec_tint", of), self.share(values, "clearcoat", of)
        if tint > 0 and metallic < 1:
            if texture is not None:
                self.note(f"spec_tint of {of} has the mean colour of the texture base_color")
            base = self.textures.mean(values["base_color"]) if texture is not None else np.array(self.rgb(values, "base_color", of))
            if transmission > 0:
                self.note(f"spec_tint of {of} is left out for its glass")
            if base @ LUMINANCE > 0:
                specular_color = 1 - tint + tint * base / (base @ LUMINANCE)
        if clearcoat > 0:
            self.note(f"the clear coat of {of} is that of glTF: GGX instead of GTR1, stronger at grazing angles, over darker layers")
        # GGX is nearest to GTR1, in total variation, if its alpha is the square root of the alpha of GTR1. Then the median angles are equal.
        coat = (0.1 + (0.001 - 0.1) * self.share(values, "clearcoat_gloss", of)) ** 0.25 if clearcoat > 0 else 0.0
        return Material(
            color, specular_color=tuple(specular_color), ior=max(eta, 1.0), transmission=transmission, clearcoat=clearcoat,
            clearcoat_roughness=coat, texture=texture, **surface, **sides,
        )

    def surface(self, values, of, uvs):
        """Roughness and metalness of the principled BSDF, and their textures."""
        keys = [key for key in ("roughness", "metallic") if self.convertible(values, key) is not None]
        whats = [f"the texture {key} of {of}" for key in keys]
        textures = self.textures.numbers([values[key] for key in keys], whats, uvs)
        if textures is None:
            # The texture of the metalness becomes its mean.
            del keys[1:], whats[1:]
            textures = self.textures.numbers([values[key] for key in keys], whats, uvs)
        surface = {key: 1.0 if key in keys else self.share(values, key, of) for key in ("roughness", "metallic")}
        return {**surface, **{f"{key}_texture": texture for key, texture in zip(keys, textures)}}

    def roughness(self, values, of, uvs):
        """Roughness of glTF, the square root of the alpha of GGX, and its texture or ``None``."""
        node = self.convertible(values, "alpha")
        if node is not None:
            return 1.0, self.textures.roughness(node, f"the texture alpha of {of}", uvs)
        if self.is_known(values, "alpha_u"):
            self.note(f"the roughness of {of} is anisotropic; it becomes its geometric mean")
            alpha = math.sqrt(self.mean(values, "alpha_u", 0.1, of) * self.mean(values, "alpha_v", 0.1, of))
        else:
            alpha = self.mean(values, "alpha", 0.1, of)
        return math.sqrt(min(max(alpha, 0.0), 1.0)), None

    def color(self, values, key, of, uvs, root=0.0):
        """Three numbers, and the texture that multiplies them or ``None``. For `root` see :func:`mix_root`."""
        node = self.convertible(values, key)
        if node is None:
            return tuple(mix_root(np.array(self.rgb(values, key, of)), root).tolist()), None
        return (1.0, 1.0, 1.0), self.textures.color(node, f"the texture {key} of {of}", uvs, root)

    def convertible(self, values, key):
        """The texture of Mitsuba that is this parameter and becomes a texture; ``None`` if there is none."""
        node = self.texture(values, key)
        return node if node is not None and self.textures.can_convert(node) and self.textures.has_valid_transform(node) else None

    def texture(self, values, key):
        """The texture of Mitsuba that is this parameter; ``None`` if the parameter is no texture."""
        node = values.get(key)
        return node if isinstance(node, self.mi.Texture) and f"{key}.value" not in values else None

    def rgb(self, values, key, of):
        """Three numbers. A texture becomes its mean."""
        node = self.texture(values, key)
        if node is not None and self.textures.can_convert(node):
            self.note(f"the texture {key} of {of} becomes its mean colour")
            return tuple(float(x) for x in self.textures.mean(node))
        if node is not None:
            self.note(f"the texture {key} of {of}, a {node.class_name()}, becomes 0.5")
            return (0.5, 0.5, 0.5)
        for full in (f"{key}.value", key):
            if full in values:
                value = np.array(values[full], float).ravel()
                return tuple(float(x) for x in (np.repeat(value, 3) if value.size == 1 else value[:3]))
        self.note(f"{key} of {of} is not a colour; it becomes 1")
        return (1.0, 1.0, 1.0)

    def is_known(self, values, key):
        return f"{key}.value" in values or key in values

    def mean(self, values, key, default, of):
        return float(np.mean(self.rgb(values, key, of))) if self.is_known(values, key) else default

    def share(self, values, key, of):
        """The mean, limited to numbers from 0 to 1."""
        return min(max(self.mean(values, key, 0.0, of), 0.0), 1.0)

    def leave_out(self, values, key, of, neutral=1.0):
        """Lists a parameter that has an effect."""
        if self.is_known(values, key) and (self.texture(values, key) is not None or self.rgb(values, key, of) != (neutral,) * 3):
            self.note(f"{key} of {of} is left out")

    # Lights and cameras.

    def emitter(self, emitter, name):
        kind, values = emitter.class_name(), self.values(emitter)
        if kind == "AreaLight":
            return
        if kind == "PointLight":
            position = np.array(values["position"], float).ravel()
            self.scene.add_light("point", name, position.tolist(), intensity=list(self.rgb(values, "intensity", f"'{name}'")))
        elif kind == "SpotLight" and "cutoff_angle" not in values:
            self.note(f"the spot '{name}' is left out; Mitsuba tells its angles from version 3.9 on")
        elif kind == "SpotLight":
            matrix = _matrix(values["to_world"])
            outer, inner = (float(np.array(values[key]).item()) for key in ("cutoff_angle", "beam_width"))
            self.leave_out(values, "texture", f"the spot '{name}'")
            self.note(f"the light of the spot '{name}' falls off between its angles as in glTF, not linearly")
            self.scene.add_light(
                "spot", name, matrix[:3, 3].tolist(), direction=matrix[:3, 2].tolist(), inner_angle=inner, outer_angle=outer,
                intensity=list(self.rgb(values, "intensity", f"'{name}'")),
            )
        else:
            self.note(f"the emitter '{name}' of the type {kind} is left out")

    def sensor(self, sensor, name):
        kind, values = sensor.class_name(), self.values(sensor)
        if kind != "PerspectiveCamera":
            self.note(f"the sensor '{name}' of the type {kind} is left out")
            return
        matrix = _matrix(values["to_world"])
        width, height = (int(x) for x in np.array(values["film.size"]).ravel())
        crop = np.array(values["film.crop_size"]).ravel()
        if tuple(crop) != (width, height):
            self.note(f"the crop of the sensor '{name}' is left out; give it as the setting crop")
        if any(float(np.array(values.get(f"principal_point_offset_{axis}", 0)).item()) for axis in "xy"):
            self.note(f"the principal point of the sensor '{name}' is left out")
        if float(np.array(values["near_clip"]).item()) > NEAR:
            self.note(f"near_clip of the sensor '{name}' is left out")
        # Mitsuba's cameras look along +Z, with +X to the left and +Y up.
        pose = np.eye(4)
        pose[:3, :3] = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0) * (-1, -1, 1)
        pose[:3, 3] = matrix[:3, 3]
        half = math.tan(math.radians(float(np.array(values["x_fov"]).item())) / 2) * height / width
        if np.linalg.det(pose[:3, :3]) < 0:
            raise SceneError(f"the sensor '{name}' mirrors its image; remove the mirror from its transform")
        self.scene.add_camera(name, Camera(pose, (width, height), math.degrees(2 * math.atan(half)), name=name))


def _matrix(transform):
    """The 4 x 4 matrix of a transform of any variant."""
    return np.array(transform.matrix, float).reshape(4, 4) if hasattr(transform, "matrix") else np.array(transform, float)
