"""Parameters of objects of Mitsuba 3, as numbers and colours."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._mitsuba_texture import Textures, children


class Notes(list):
    """Sentences, each one once."""

    def add(self, text: str) -> None:
        if text not in self:
            self.append(text)


class Values:
    """Reads parameters. `note` takes sentences about parameters that are approximated or left out."""

    def __init__(self, mi: Any, note: Any, textures: Textures) -> None:
        self.mi = mi
        self.note = note
        self.textures = textures

    def values(self, item):
        """The parameters of an object and of its nested objects, by name. Textures have the name of the parameter that they are."""
        values = parameters(self.mi, item)
        for name, child in children(self.mi, item).items():
            if isinstance(child, self.mi.Texture):
                values[name] = child
                values.update({f"{name}.{key}": value for key, value in self.values(child).items()})
        return values

    def number(self, values, key, default=0.0):
        return float(np.array(values[key]).ravel()[0]) if key in values else default

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


def kind_of(item):
    """The name of the class of an object. Plugins in Python have a name of their own there."""
    own = type(item).__name__
    return own if type(item).__module__.split(".")[0] != "mitsuba" else item.class_name()


def parameters(mi, item):
    """The parameters of an object, and those of its nested objects under ``name.parameter``, by name."""
    try:
        found = mi.traverse(item)
        return {key: found[key] for key in found.keys()}
    except TypeError:
        # ``mi.traverse`` fails if an object lacks a part, such as the absorption of hair.
        return _own_parameters(mi, item, "")


def _own_parameters(mi, item, prefix):
    # As in `children`, no reference cycle may hold an object of Mitsuba.
    class Parameters(mi.TraversalCallback):
        def put(self, name, value, flags, cpptype=None):
            if value is not None and not isinstance(value, mi.Object):
                self.put_value(name, value, flags, cpptype)

        def put_value(self, name, value, flags, cpptype=None):
            self.found[name] = value, cpptype

        put_parameter = put_value

        def put_object(self, name, node, flags):
            pass

    callback = Parameters()
    callback.found = {}
    item.traverse(callback)
    values = {}
    for name, (value, kind) in callback.found.items():
        values[prefix + name] = value if kind is None else mi.get_property(value, kind, item)
    for name, child in children(mi, item).items():
        values.update(_own_parameters(mi, child, f"{prefix}{name}."))
    return values


def matrix_of(transform):
    """The 4 x 4 matrix of a transform of any variant."""
    return np.array(transform.matrix, float).reshape(4, 4) if hasattr(transform, "matrix") else np.array(transform, float)
