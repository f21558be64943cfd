"""Scenes: files, and scenes from arrays."""

from __future__ import annotations

import copy
import hashlib
import json
import os
import threading
import types
import weakref
from collections.abc import Iterable, Mapping
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._arrays import array_of, matrix_of, near_origin, translation
from ._camera import Camera
from ._errors import SettingsError
from ._material import TEXTURES, Material, plain_numbers
from ._texture import FILTERS, Texture, color_bytes, surface_bytes
from ._words import words

# Settings that choose or place another camera than the first one of the scene.
PLACING = ("camera", "look_from", "look_at")
LIGHTS = ("point", "spot", "beam")


class Scene:
    """A scene from arrays; :func:`load` reads one from a file.

    Keyword arguments are settings of all renders of the scene. They override those of its cameras, such as ``resolution`` and ``fov``; a render
    overrides both. Lengths are in metres. ``density_grid`` may be an array (Z, Y, X) of densities, here and in :func:`render`. A scene can be
    pickled: it remembers its file, or its arrays. Arrays are copied when they are added.

    Renders of a scene share the device and the kernels. They also share the prepared meshes, as long as only cameras, lights, gates, the seed
    and the instances with ``moves=True`` change.
    """

    def __init__(self, **settings: Any) -> None:
        self._forget_natives()
        self.path: Optional[str] = None
        self.moves: tuple[str, ...] = ()
        self.settings = settings
        #: Cameras by name. The first one is the default.
        self.cameras: dict[str, Camera] = {}
        #: What :func:`from_mitsuba` approximated or left out, one sentence each.
        self.not_converted: list[str] = []
        self._materials: dict[str, Material] = {}
        self._meshes: dict[str, dict[str, Any]] = {}
        self._instances: dict[str, tuple[str, np.ndarray, bool]] = {}
        self._lights: dict[str, dict[str, Any]] = {}
        self._media: dict[str, dict[str, Any]] = {}
        self._scan: Optional[dict[str, Any]] = None
        self._moved: dict[str, np.ndarray] = {}

    @property
    def settings(self) -> Mapping[str, Any]:
        """Settings of all renders of the scene. To change them, assign a dictionary, such as ``{**scene.settings, "spp": 16}``."""
        return types.MappingProxyType(self._settings)

    @settings.setter
    def settings(self, settings: Mapping[str, Any]) -> None:
        words(settings, "Scene")
        self._settings = {key: value.copy() if isinstance(value, np.ndarray) else value for key, value in settings.items()}
        self._changed()

    @property
    def scan(self) -> Optional[dict[str, Any]]:
        """The table ``[scan]`` of an experiment as a dictionary, with underscores for dashes; ``None`` if the scene is no scan. With a table,
        :func:`taugate.scan` measures the scene."""
        return copy.deepcopy(self._scan)

    @scan.setter
    def scan(self, table: Optional[Mapping[str, Any]]) -> None:
        self._refuse_if_from_file("a scan by the table [scan] of an experiment")
        self._scan = None if table is None else plain_numbers(table)
        self._changed()

    # Objects.

    def add_material(self, name: str, material: Material) -> None:
        """Adds or replaces a :class:`Material`."""
        self._refuse_if_from_file()
        self._materials[name] = self._own(material)
        self._changed()

    def add_mesh(
        self,
        name: str,
        vertices: ArrayLike,
        triangles: ArrayLike,
        material: Optional[Union[Material, str]] = None,
        *,
        transform: Optional[ArrayLike] = None,
        normals: Optional[ArrayLike] = None,
        uvs: Optional[ArrayLike] = None,
        moves: bool = False,
    ) -> None:
        """Adds or replaces a mesh and places it.

        ``vertices`` (N, 3) in metres; ``triangles`` (M, 3) indices of vertices, counter-clockwise as seen from the front; ``normals`` (N, 3) for
        smooth shading; ``uvs`` (N, 2) for textures: (0, 0) is the top left corner of the image, and (1, 1) the bottom right one.
        ``material``: a :class:`Material` or the name of one; by default grey and diffuse. ``transform``
        (4 x 4) maps mesh space to world space; ``None``: the identity. ``moves``: whether the instance will move (see :meth:`set_transform`).
        """
        self._refuse_if_from_file()
        if isinstance(material, str) and material not in self._materials:
            raise SettingsError(f"the scene has no material '{material}'; add it with add_material")
        vertices, centre = near_origin(vertices)
        self._meshes[name] = {
            "name": name,
            "vertices": vertices,
            # The vertices are relative to this point. The transforms of instances add it again.
            "centre": centre,
            "triangles": array_of(triangles, np.uint32, 2, "triangles"),
            "normals": None if normals is None else array_of(normals, np.float32, 2, "normals"),
            "uvs": None if uvs is None else array_of(uvs, np.float32, 2, "uvs"),
            # The name of a material, or the mesh's own material.
            "material": self._own(material) if material else Material.diffuse(),
        }
        self._changed()
        self.add_instance(name, name, transform, moves=moves)

    def add_instance(self, name: str, mesh: str, transform: Optional[ArrayLike] = None, *, moves: bool = False) -> None:
        """Adds or replaces an instance: a placement of a mesh."""
        self._refuse_if_from_file()
        if mesh not in self._meshes:
            raise SettingsError(f"the scene has no mesh '{mesh}'; add it with add_mesh")
        self._instances[name] = (mesh, matrix_of(transform), bool(moves))
        self._stale = True

    def add_light(self, kind: str, name: str, position: ArrayLike, **more: Any) -> None:
        """Adds or replaces a light without a surface: a ``point`` (``intensity`` in W/sr), a ``spot`` (``intensity``, ``direction`` or
        ``target``, ``inner_angle``, ``outer_angle`` in degrees) or a ``beam`` (``power`` in W, ``radius``, ``direction`` or ``target``)."""
        self._refuse_if_from_file("lights with the settings lamp=... and headlamp=...")
        if kind not in LIGHTS:
            raise SettingsError(f"the light is a {kind!r}; choose one of {', '.join(LIGHTS)}")
        self._lights[name] = {"type": kind, "name": name, "position": position, **more}
        self._stale = True

    def add_medium(
        self,
        name: str,
        *,
        sigma_s: ArrayLike = 0.0,
        sigma_a: ArrayLike = 0.0,
        phase: Optional[Mapping[str, Any]] = None,
        bounds: Optional[ArrayLike] = None,
        density: Optional[ArrayLike] = None,
        transform: Optional[ArrayLike] = None,
        filter: str = "linear",
    ) -> None:
        """Adds or replaces a medium: fog or smoke. Where media overlap, the last one counts. Settings of a medium, such as ``sigma_s`` or
        ``mor``, replace all of them; ``no_medium=True`` leaves them out.

        ``sigma_s`` and ``sigma_a`` are per metre, one number or three. ``phase`` is isotropic by default, or as in ``extras.medium`` of glTF files,
        such as ``{"type": "hg", "g": 0.8}``. ``bounds`` are two corners of a box in metres; ``None``: everywhere. ``density`` (Z, Y, X) multiplies the
        coefficients in the box of ``bounds``, which ``transform`` (4 x 4) places in the world. ``filter``: ``"linear"`` or ``"nearest"``.
        """
        self._refuse_if_from_file("media with settings such as sigma_s=... and density_grid=...")
        if filter not in FILTERS:
            raise SettingsError(f"the filter of the medium '{name}' is {filter!r}; choose linear or nearest")
        if density is None and transform is not None:
            raise SettingsError(f"the medium '{name}' has a transform, but no density; give it its bounds in the world")
        medium = {"sigma_s": sigma_s, "sigma_a": sigma_a, "phase": phase, "bounds": bounds}
        self._media[name] = {
            "name": name,
            "medium": plain_numbers({key: value for key, value in medium.items() if value is not None}),
            "density": None if density is None else array_of(density, np.float32, 3, "density"),
            "transform": matrix_of(transform).tolist(),
            "linear": filter == "linear",
        }
        self._changed()

    def add_camera(self, name: str, camera: Camera) -> None:
        """Adds or replaces a :class:`Camera`. Renders use the first one, unless they have ``camera="name"``, ``look_from`` or ``look_at``.
        Other settings, such as ``fov``, change it for one render."""
        self.cameras[name] = camera

    def remove(self, name: str) -> None:
        """Removes the mesh, instance, light, medium or camera of this name. A mesh takes its instances with it."""
        kinds = (self._meshes, self._instances, self._lights, self._media, self.cameras)
        found = [objects for objects in kinds if name in objects]
        if not found:
            raise SettingsError(f"the scene has no mesh, instance, light, medium or camera '{name}'; check the name")
        for objects in found:
            del objects[name]
        self._instances = {key: one for key, one in self._instances.items() if one[0] in self._meshes}
        self._changed()

    def set_transform(self, name: str, matrix: ArrayLike) -> None:
        """Moves an instance, or the node of a file: ``matrix`` (4 x 4) maps mesh space to world space. If a file has several instances of
        this name, such as copies of a node, ``matrix`` is that of the first. The others keep their places relative to it.

        If the instance was added with ``moves=True``, or :func:`load` named it in ``moves``, the next render repeats only a part of the
        preparation. Otherwise the next render prepares the whole scene anew. The image is the same, except for rounding.
        """
        moved = matrix_of(matrix)
        if self.path is None:
            if name not in self._instances:
                raise SettingsError(f"the scene has no instance '{name}'; check the name")
            mesh, _, moves = self._instances[name]
            self._instances[name] = (mesh, moved, moves)
            self._stale = True
        else:
            self._built().set_transform(name, moved.tolist())
            self._moved[name] = moved

    def transform(self, name: str) -> np.ndarray:
        """The matrix (4 x 4) of an instance, or of the first instance of a node of a file. It maps mesh space to world space."""
        if self.path is None and name in self._instances:
            return self._instances[name][1].copy()
        return np.array(self._built().transform(name))

    # What renders see.

    def camera(self, **settings: Any) -> Camera:
        """The :class:`Camera` that a render with these settings has."""
        native, flags = self._job(settings, "camera")
        return Camera._of(native.view(flags))

    def info(self, arrival: bool = False, **settings: Any) -> dict[str, Any]:
        """A dictionary that describes the scene as a render with these settings sees it: ``cameras`` and ``emitters`` (names), ``objects`` (names
        by number), ``triangles``, ``bounds`` (two corners in metres), ``diagonal``, ``media`` (how many), ``resolution``, ``notes``, ``warnings``.

        With ``arrival=True``, which needs a device, also ``arrival``: first, 5 %, 50 %, 95 % and last of the travel times of the light, in metres
        (``None``: no light arrives), and ``suggested_gate``, which shows light. Suns and the sky are left out: their light has no travel time.
        """
        native, flags = self._job(settings, "info")
        info = native.info(flags, arrival)
        return {**info, "cameras": list(self.cameras) + [name for name in info["cameras"] if name != "look" or not self.cameras]}

    def experiment(self, **settings: Any) -> str:
        """The settings of a render as an experiment file (TOML) of the program. Settings that were not given have their defaults."""
        native, flags = self._job(settings, "experiment")
        return native.settings(flags)

    # Inside.

    def _refuse_if_from_file(self, instead="objects by changing that file"):
        if self.path is not None:
            raise SettingsError(f"this scene was read from a file; add {instead}")

    def _changed(self):
        """Forgets the native scene after a change of meshes, materials or settings. The next render makes it again."""
        self._native = None
        #: The settings that the native scene has, with their temporary files.
        self._words = None
        self._stale = True

    def _forget_natives(self):
        """Resets the attributes that a copy or a pickle does not share with the scene."""
        #: Two threads may use a scene that is not prepared yet.
        self._lock = threading.RLock()
        self._native = self._words = None
        self._stale = True
        #: Texels of materials by their contents, so that materials share equal images.
        self._texels = weakref.WeakValueDictionary()

    def _own(self, material):
        """A copy of the material. If the caller changes an array later, the copy keeps its values. A name is returned as it is."""
        if isinstance(material, str):
            return material
        copies = {}
        for field in TEXTURES:
            texture = getattr(material, field, None)
            texels = texture.texels if isinstance(texture, Texture) else texture
            if isinstance(texels, np.ndarray):
                key = hashlib.sha256(repr((texels.shape, texels.dtype.str)).encode() + np.ascontiguousarray(texels).tobytes()).digest()
                # The keys of deepcopy's memo are identities.
                copies[id(texels)] = self._texels.setdefault(key, texels.copy())
        return copy.deepcopy(material, copies)

    def _job(self, settings, call):
        """The native scene, and the flags of a render with these settings."""
        return self._built(), words(self._with_camera(settings), call)

    def _with_camera(self, settings):
        settings = dict(settings)
        camera = settings.get("camera")
        # Settings that override the camera's: the settings of the call. If the camera belongs to the scene, the settings of the scene
        # override it too.
        given = {key: value for key, value in settings.items() if key != "camera" and value is not None}
        overriding = {**{key: value for key, value in self._settings.items() if key != "camera" and value is not None}, **given}
        if camera is None and not any(key in given for key in PLACING):
            camera = self._camera_of_settings()
        if isinstance(camera, str) and camera in self.cameras:
            camera = self.cameras[camera]
            # This camera was chosen by name, so look_from and look_at in the settings of the scene do not override it.
            overriding = {key: value for key, value in overriding.items() if key in given or key not in PLACING}
        elif camera is None and self.cameras and not any(key in overriding for key in PLACING):
            camera = next(iter(self.cameras.values()))
        elif isinstance(camera, Camera):
            overriding = given
        if isinstance(camera, Camera):
            of_camera = camera._settings()
            if "fov" in overriding or "ortho" in overriding:
                # A camera has one of the two.
                of_camera.pop("fov", None)
                of_camera.pop("ortho", None)
            if "resolution" in overriding:
                # The crop is a part of the camera's own image.
                of_camera.pop("crop", None)
            settings = {**{key: value for key, value in of_camera.items() if key not in overriding}, **given}
        elif camera is not None:
            settings["camera"] = camera
        return settings

    def _camera_of_settings(self):
        """The name of the camera in the settings of the scene; ``None`` without one, or if the native scene can find it itself."""
        name = self._settings.get("camera")
        return name if isinstance(name, str) and (name in self.cameras or self.path is None and name != "auto") else None

    def _built(self):
        native = self._native
        if native is not None:
            # Fails in a progress function of a render of this scene. There, waiting for `_lock` could last forever: another thread may
            # hold the lock until the render ends.
            native.check_idle()
        with self._lock:
            return self._built_with_lock()

    def _built_with_lock(self):
        if self.path is not None:
            if self._native is None:
                self._words = self._own_words("load")
                native = _native.NativeScene.load(self.path, self._words, list(self.moves))
                for name, matrix in self._moved.items():
                    native.set_transform(name, matrix.tolist())
                self._native = native
            return self._native
        native = self._native
        if native is None:
            self._native = native = self._from_arrays()
        if self._stale:
            meshes = list(self._meshes)
            native.place({
                "instances": [
                    (name, meshes.index(mesh), (matrix @ translation(self._meshes[mesh]["centre"])).tolist())
                    for name, (mesh, matrix, _) in self._instances.items()
                ],
                "lights": json.dumps(list(self._lights.values()), default=lambda value: np.asarray(value).tolist()),
                "moves": [name for name, (_, _, moves) in self._instances.items() if moves],
            })
            self._stale = False
        return native

    def _own_words(self, call):
        known = self._camera_of_settings() is None
        return words({key: value for key, value in self._settings.items() if key != "camera" or known}, call)

    def _from_arrays(self):
        textures, images, materials, index_of = [], [], [], {}
        own = [(name, mesh["material"]) for name, mesh in self._meshes.items() if not isinstance(mesh["material"], str)]
        for name, material in [*self._materials.items(), *own]:
            indices = {}
            is_opaque = material.alpha >= 1
            # The native part has one texture for roughness and metalness.
            for field, bytes, parts in (
                ("texture", color_bytes, ("texture",)), ("roughness_texture", surface_bytes, ("roughness_texture", "metallic_texture")),
            ):
                of_part = {part: getattr(material, part) for part in parts}
                of_part = {part: one if one is None or isinstance(one, Texture) else Texture(one) for part, one in of_part.items()}
                samplers = [one._sampler(f"{part} of '{name}'") for part, one in of_part.items() if one is not None]
                indices[field] = len(textures) if samplers else None
                if not samplers:
                    continue
                if samplers[0] != samplers[-1]:
                    raise SettingsError(f"the {' and the '.join(parts)} of '{name}' become one image; give them the same wrap, filter and transform")
                # Materials may share an image.
                texels = [None if one is None else one.texels for one in of_part.values()]
                key = (field, *map(id, texels))
                if key not in index_of:
                    index_of[key] = len(images)
                    images.append(bytes(*texels, name))
                textures.append({**samplers[0], "image": index_of[key]})
                is_opaque = is_opaque and images[index_of[key]][..., 3].min() == 255
            materials.append({**material._plain(name, indices), "blend": not is_opaque})
        names, own_index, meshes = list(self._materials), len(self._materials), []
        for name, mesh in self._meshes.items():
            if isinstance(mesh["material"], str):
                material, index = self._materials[mesh["material"]], names.index(mesh["material"])
            else:
                material, index, own_index = mesh["material"], own_index, own_index + 1
            if mesh["uvs"] is None and material._has_textures():
                raise SettingsError(f"the material of the mesh '{name}' has a texture, so the mesh needs uvs")
            meshes.append({**mesh, "material": index})
        self._words = self._own_words("Scene")
        media = [{**medium, "medium": json.dumps(medium["medium"])} for medium in self._media.values()]
        scan = None if self._scan is None else json.dumps(self._scan)
        return _native.NativeScene.from_arrays(json.dumps(materials), json.dumps(textures), images, meshes, media, scan, self._words)

    def __getstate__(self):
        return {key: value for key, value in self.__dict__.items() if key not in ("_lock", "_native", "_words", "_stale", "_texels")}

    def __setstate__(self, state):
        self.__dict__.update(state)
        self._forget_natives()

    def __copy__(self):
        twin = object.__new__(type(self))
        # The objects are shared, but not the dictionaries and lists.
        twin.__setstate__({key: copy.copy(value) if isinstance(value, (dict, list)) else value for key, value in self.__getstate__().items()})
        return twin

    def __deepcopy__(self, memo):
        twin = object.__new__(type(self))
        twin.__setstate__(copy.deepcopy(self.__getstate__(), memo))
        return twin

    def __repr__(self) -> str:
        if self.path is not None:
            return f"<taugate.Scene of {self.path}>"
        return f"<taugate.Scene of {len(self._instances)} instances, {len(self._lights)} lights>"


def load(path: str | os.PathLike[str], *, moves: Union[str, Iterable[str]] = (), **settings: Any) -> Scene:
    """Reads a scene (.glb, .gltf) or an experiment (.toml), and returns a :class:`Scene`.

    Keyword arguments are settings of all renders of the scene. They have the names of the flags of the program, with underscores for dashes;
    :func:`settings` lists them. ``moves`` names nodes that :meth:`Scene.set_transform` will move.
    """
    scene = Scene(**settings)
    scene.path = os.fspath(path)
    scene.moves = (moves,) if isinstance(moves, str) else tuple(moves)
    scene._built()
    return scene
