"""Materials."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import ArrayLike

from ._errors import SettingsError, explain_changes
from ._texture import Texture

# Keys of a medium inside of a mesh.
MEDIUM = ("sigma_s", "sigma_a", "phase")
TEXTURES = ("texture", "roughness_texture", "metallic_texture")


@explain_changes
@dataclasses.dataclass(frozen=True)
class Material:
    """A metallic-roughness material of glTF, with its extensions. Colours are linear RGB.

    ``color`` is the base colour, and ``alpha`` its coverage. ``emission`` is radiance in W/(m^2 sr). With ``specular`` 0 and ``metallic`` 0 a
    material is purely diffuse. ``texture`` multiplies the base colour and alpha, ``roughness_texture`` the roughness, and
    ``metallic_texture`` the metalness (which is 0 unless you set it). Each is a :class:`Texture`, or its texels (H, W), (H, W, 1) or, for
    colours, (H, W, 3) or (H, W, 4). Meshes of such a material need ``uvs``. The textures of roughness and metalness become one image: they
    need the same shape, wrap modes, filter and transform.

    ``thin``: whether surfaces that transmit light are thin glass: light passes straight on, and they bound no solid. ``None``: meshes that are
    open are thin, and closed ones are solid. ``thickness`` is the thickness of thin glass in metres; it delays light.

    ``interior`` is a medium inside of closed meshes that transmit light: a dictionary with ``sigma_s``, ``sigma_a`` (per metre, one number or
    three) and ``phase``, see :meth:`Scene.add_medium`. With a ``transmission`` of 1, a white colour and the ``ior`` of its surroundings, the mesh
    only bounds the medium.

    The fields do not change; ``dataclasses.replace(material, color=...)`` makes another material.
    """

    color: ArrayLike = (1.0, 1.0, 1.0)
    alpha: float = 1.0
    metallic: float = 0.0
    roughness: float = 1.0
    specular: float = 1.0
    specular_color: ArrayLike = (1.0, 1.0, 1.0)
    ior: float = 1.5
    transmission: float = 0.0
    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.0
    emission: ArrayLike = (0.0, 0.0, 0.0)
    double_sided: bool = True
    thin: Optional[bool] = None
    thickness: float = 0.0
    interior: Optional[Mapping[str, Any]] = None
    texture: Optional[Union[ArrayLike, Texture]] = None
    roughness_texture: Optional[Union[ArrayLike, Texture]] = None
    metallic_texture: Optional[Union[ArrayLike, Texture]] = None

    @classmethod
    def diffuse(cls, color: ArrayLike = (0.5, 0.5, 0.5), **more: Any) -> Material:
        """A Lambertian surface with this albedo."""
        return cls(color=_rgb(color), specular=0.0, **more)

    @classmethod
    def plastic(cls, color: ArrayLike = (0.5, 0.5, 0.5), roughness: float = 0.3, **more: Any) -> Material:
        """A diffuse base under a glossy coat."""
        return cls(color=_rgb(color), roughness=roughness, **more)

    @classmethod
    def metal(cls, color: ArrayLike = (0.9, 0.9, 0.9), roughness: float = 0.2, **more: Any) -> Material:
        """A conductor; a mirror at roughness 0."""
        return cls(color=_rgb(color), roughness=roughness, metallic=1.0, **more)

    @classmethod
    def glass(
        cls, ior: float = 1.5, roughness: float = 0.0, *, thin: Optional[bool] = None, thickness: float = 0.0, **more: Any
    ) -> Material:
        """A clear dielectric. Closed meshes are solid glass, and open ones panes, unless ``thin`` says otherwise."""
        return cls(ior=ior, roughness=roughness, transmission=1.0, thin=thin, thickness=thickness, **more)

    @classmethod
    def emitter(cls, radiance: ArrayLike, **more: Any) -> Material:
        """A lamp with this radiance in W/(m^2 sr) on its front, which reflects nothing."""
        return cls(**{"color": (0.0, 0.0, 0.0), "specular": 0.0, "emission": _rgb(radiance), "double_sided": False, **more})

    def _has_textures(self):
        return any(getattr(self, field) is not None for field in TEXTURES)

    def _plain(self, name, textures):
        """The fields as the native part takes them; `textures` has the indices of the textures by native field."""
        plain = {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name not in TEXTURES}
        for key in ("color", "specular_color", "emission"):
            plain[key] = _rgb(plain[key])
        plain = {key: value.item() if isinstance(value, np.generic) else value for key, value in plain.items()}
        if plain["interior"] is not None:
            plain["interior"] = medium_form(plain["interior"], f"the interior of '{name}'")
        return {**plain, **textures, "name": name}


def medium_form(medium, what):
    """A medium in the form of ``extras.medium`` of glTF files, as plain numbers, lists and text."""
    unknown = [key for key in medium if key not in MEDIUM]
    if unknown:
        raise SettingsError(f"{what} has no {unknown[0]}; choose from {', '.join(MEDIUM)}")
    return plain_numbers(medium)


def plain_numbers(value):
    """The value with lists and numbers of Python instead of arrays of NumPy."""
    if isinstance(value, Mapping):
        return {key: plain_numbers(one) for key, one in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return [plain_numbers(one) for one in value] if isinstance(value, (list, tuple)) else value


def _rgb(color):
    """Three numbers from one or three."""
    values = np.broadcast_to(np.asarray(color, float), 3)
    return tuple(float(x) for x in values)
