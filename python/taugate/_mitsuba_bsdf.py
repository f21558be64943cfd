"""Materials from BSDFs of Mitsuba 3."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ._material import TEXTURES, Material
from ._mitsuba_texture import LUMINANCE, children, mix_root
from ._mitsuba_values import Values, kind_of

KINDS = (
    "Principled", "SmoothDiffuse", "SmoothPlastic", "RoughPlastic", "SmoothConductor", "RoughConductor", "SmoothDielectric", "RoughDielectric",
    "ThinDielectric", "BlendBSDF", "Null",
)
# BSDFs around another one, and their names.
WRAPPERS = {"TwoSidedBRDF": "two-sided BSDF", "MaskBSDF": "mask", "BumpMap": "bump map", "NormalMap": "normal map"}
# Fields of a material in which its reflected and transmitted light is linear.
LINEAR = ("color", "metallic", "specular", "transmission", "clearcoat")
# A surface that lets all light pass.
NULL = Material(color=(1.0, 1.0, 1.0), alpha=0.0, specular=0.0)


class Materials(Values):
    """Makes a :class:`Material` of each BSDF."""

    def material(self, bsdf, name, uvs, is_twosided=False):
        """The material of a BSDF. `name`: of the shape; `uvs`: texture coordinates of its mesh."""
        of = f"the BSDF of '{name}'"
        opacity, holes = 1.0, None
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
        return dataclasses.replace(material, alpha=opacity * material.alpha)

    def inner_material(self, bsdf, name, uvs, is_twosided):
        """The material of a BSDF that is not around another one."""
        of, kind = f"the BSDF of '{name}'", kind_of(bsdf)
        if kind not in KINDS:
            self.note(f"the BSDF {kind} of '{name}' becomes grey and diffuse")
            return Material.diffuse(0.5)
        if kind == "Null":
            return NULL
        if kind == "BlendBSDF":
            return self.blend(bsdf, name, uvs, is_twosided)
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
            mean = np.array(color) if texture is None else self.textures.mean(values["diffuse_reflectance"])
            eta = self.mean(values, "eta", 1.49, of)
            # Mitsuba's plastics lose light below their coats, rough ones up to a third of it.
            color = np.clip(np.array(color) * self.below_coat(bsdf, mean, eta, kind), 0, 1)
            return Material.plastic(tuple(color.tolist()), roughness, ior=eta, texture=texture, **sides)
        if kind.endswith("Conductor"):
            self.note(f"the conductor of '{name}' has its reflectance at normal incidence, and Schlick's rise towards grazing angles")
            eta, k = (np.array(self.rgb(values, key, of)) for key in ("eta", "k"))
            color, texture = ((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2), None
            if any(key.startswith("specular_reflectance") for key in values):
                factor, texture = self.color(values, "specular_reflectance", of, uvs)
                color = color * np.array(factor)
            return Material.metal(tuple(np.clip(color, 0, 1)), roughness, texture=texture, **sides)
        return self.glass(kind, values, roughness, sides["roughness_texture"], name)

    def below_coat(self, bsdf, mean, eta, kind):
        """The albedo of the diffuse part of a plastic, divided by that of glTF: three numbers. `mean`: its reflectance."""
        import drjit as dr

        random = np.random.default_rng(1)
        count = 2048 if self.mi.variant().startswith("scalar") else 1 << 15
        uv, sine2, angle = random.random((2, count)), random.random((2, count)), 2 * np.pi * random.random((2, count))
        # Directions with the density cosine / pi.
        to_sensor, to_light = np.stack([np.sqrt(sine2) * np.cos(angle), np.sqrt(sine2) * np.sin(angle), np.sqrt(1 - sine2)], axis=1)
        context = self.mi.BSDFContext()

        def albedo(component):
            context.component = component
            if self.mi.variant().startswith("scalar"):
                one, total = dr.zeros(self.mi.SurfaceInteraction3f), np.zeros(3)
                for k in range(count):
                    one.wi, one.uv = self.mi.Vector3f(to_sensor[:, k].tolist()), self.mi.Point2f(uv[:, k].tolist())
                    total += np.array(bsdf.eval(context, one, self.mi.Vector3f(to_light[:, k].tolist())), float) / to_light[2, k]
                return np.pi * total / count
            many = dr.zeros(self.mi.SurfaceInteraction3f, count)
            many.wi, many.uv = self.mi.Vector3f(*to_sensor.astype(np.float32)), self.mi.Point2f(*uv.astype(np.float32))
            value = bsdf.eval(context, many, self.mi.Vector3f(*to_light.astype(np.float32)))
            return np.array([np.pi * np.mean(np.array(value[k], float) / to_light[2]) for k in range(3)])

        # The diffuse part is the second component. A smooth coat has no value, only directions.
        coat = albedo(0) if kind.startswith("Rough") else np.full(3, _mean_fresnel(eta))
        return np.divide(albedo(1), mean * (1 - coat), out=np.ones(3), where=mean > 0)

    def glass(self, kind, values, roughness, texture, name):
        """Glass of Mitsuba, which is solid also where its mesh is open, or a thin sheet."""
        of, is_thin = f"the BSDF of '{name}'", kind == "ThinDielectric"
        self.leave_out(values, "specular_reflectance", of)
        color = (1.0, 1.0, 1.0)
        if is_thin and self.is_known(values, "specular_transmittance"):
            color = tuple(min(max(x, 0.0), 1.0) for x in self.rgb(values, "specular_transmittance", of))
        elif not is_thin:
            self.leave_out(values, "specular_transmittance", of)
        eta = self.mean(values, "eta", 1.5, of)
        if eta < 1 and is_thin:
            self.note(f"the thin glass of '{name}' has an index below 1; it becomes its inverse")
            eta = 1 / max(eta, 0.01)
        elif eta < 1:
            self.note(f"the dielectric of '{name}' has an index below 1, so its inside counts as vacuum")
        return Material.glass(max(eta, 1.0), roughness, color=color, roughness_texture=texture, thin=is_thin)

    def blend(self, bsdf, name, uvs, is_twosided):
        """The mix of two BSDFs, where a material of glTF is linear in their difference; else the heavier one."""
        of = f"the BSDF of '{name}'"
        parts = [child for child in children(self.mi, bsdf).values() if isinstance(child, self.mi.BSDF)]
        second = self.share(self.values(bsdf), "weight", f"the blend in {of}")
        # Mitsuba lists two equal BSDFs once.
        materials = [self.material(part, name, uvs, is_twosided) for part in (parts[0], parts[-1])]
        weights = (1 - second, second)
        heavier = materials[int(second > 0.5)]
        for one, other, weight in ((*materials, weights[0]), (*materials[::-1], weights[1])):
            if other.alpha == 0:
                return dataclasses.replace(one, alpha=weight * one.alpha)
        if min(weights) == 0:
            return heavier
        mixed = _mix(*materials, weights)
        if mixed is None:
            self.note(f"the blend in {of} becomes its heavier part")
        return mixed or heavier

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


def _mean_fresnel(eta):
    """Reflectance of a smooth dielectric, for light from all directions of one side."""
    cosine = np.sqrt((np.arange(1024) + 0.5) / 1024)
    inside = np.sqrt(1 - (1 - cosine**2) / eta**2)
    across, along = (cosine - eta * inside) / (cosine + eta * inside), (inside - eta * cosine) / (inside + eta * cosine)
    return float(np.mean((across**2 + along**2) / 2))


def _mix(a, b, weights):
    """The material with these shares of two materials; ``None`` if a material is not linear in their difference."""
    for one, other in ((a, b), (b, a)):
        # The roughness and the index of a diffuse surface have no effect.
        if max(one.metallic, one.specular, one.transmission, one.clearcoat) == 0:
            same = {key: getattr(other, key) for key in ("roughness", "ior", "clearcoat_roughness", "thin", "specular_color")}
            if one is a:
                a = dataclasses.replace(a, **same)
            else:
                b = dataclasses.replace(b, **same)
    names = [field.name for field in dataclasses.fields(a)]
    different = [name for name in names if not _is_same(getattr(a, name), getattr(b, name))]
    has_textures = any(getattr(a, name) is not None for name in TEXTURES)
    # A coat reflects little, so the colour below it may differ too: the error is below 1 % of the difference of the colours.
    is_coat = set(different) == {"color", "specular"} and max(a.metallic, a.transmission, a.clearcoat) == 0
    if len(different) > 1 and not is_coat or any(name not in LINEAR for name in different) or ("color" in different and has_textures):
        return None
    mix = {name: weights[0] * np.array(getattr(a, name)) + weights[1] * np.array(getattr(b, name)) for name in different}
    return dataclasses.replace(a, **{name: tuple(value.tolist()) if value.ndim else float(value) for name, value in mix.items()})


def _is_same(a, b):
    texels = [getattr(one, "texels", None) for one in (a, b)]
    if texels[0] is not None and texels[1] is not None:
        return texels[0] is texels[1] and (a.wrap, a.filter) == (b.wrap, b.filter) and np.array_equal(a.transform, b.transform)
    return np.array_equal(a, b) if isinstance(a, tuple) else a == b
