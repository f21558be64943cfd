"""Media of Mitsuba 3."""

from __future__ import annotations

import re

import numpy as np

from ._mitsuba_texture import children
from ._mitsuba_values import Values, kind_of, parameters

# Largest distance of a corner of a shape from the corner of its grid, in sides of the grid.
CORNER = 1e-3
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


class Media(Values):
    """Turns media into the arguments of :meth:`Scene.add_medium`, and into the ``interior`` of a :class:`Material`."""

    def in_box(self, medium, name, vertices):
        """The medium in a shape that only bounds it: arguments of :meth:`Scene.add_medium`. ``None`` if the shape is no box, or if the medium
        is left out. The second value says whether the mesh of the shape can bound the medium instead."""
        grid = self.grid(medium)
        if grid is None:
            interior = self.interior(medium, name)
            corners = _axis_box(vertices)
            if interior is None or corners is None:
                return None, interior
            return {**interior, "bounds": corners}, None
        interior = self.interior(medium, name)
        if interior is None:
            return None, None
        array, matrix, filter = grid
        local = np.c_[vertices, np.ones(len(vertices))] @ np.linalg.inv(matrix)[:3].T
        if not _are_corners(local):
            self.note(f"the medium of the shape '{name}' is left out: the shape is not the box of the density grid")
            return None, None
        return {**interior, "density": array, "bounds": ((0, 0, 0), (1, 1, 1)), "transform": matrix, "filter": filter}, None

    def interior(self, medium, name):
        """Coefficients and phase function as a dictionary; those of density 1 if the medium has a grid. ``None`` if the medium is left out."""
        kind = kind_of(medium)
        if kind not in ("HomogeneousMedium", "HeterogeneousMedium"):
            self.note(f"the medium of the shape '{name}', of the type {kind}, is left out")
            return None
        phase = self.phase(children(self.mi, medium).get("phase_function"), name)
        if phase is None:
            return None
        volumes = children(self.mi, medium)
        scale = float(np.array(parameters(self.mi, medium).get("scale", 1.0)).ravel()[0])
        albedo = self.constant(volumes["albedo"], f"the albedo of the medium of '{name}'")
        has_grid = self.grid(medium) is not None
        extinction = scale * (np.ones(3) if has_grid else self.constant(volumes["sigma_t"], f"sigma_t of the medium of '{name}'"))
        return {"sigma_s": (extinction * albedo).tolist(), "sigma_a": (extinction * (1 - albedo)).tolist(), "phase": phase}

    def grid(self, medium):
        """Densities (Z, Y, X), the matrix from the unit cube to the world, and the filter; ``None`` for a homogeneous medium."""
        volume = children(self.mi, medium).get("sigma_t")
        if volume is None or kind_of(volume) != "GridVolume":
            return None
        data = np.array(parameters(self.mi, volume)["data"], np.float32)
        if data.ndim == 4 and data.shape[3] > 1:
            self.note("a density grid with several channels becomes their mean")
        data = data.mean(axis=3) if data.ndim == 4 else data
        # Mitsuba tells the place of a grid only in its text.
        local = np.array([float(x) for x in NUMBER.findall(str(volume).split("to_local", 1)[1])[:16]]).reshape(4, 4)
        return data, np.linalg.inv(local), self.filter(volume, data, np.linalg.inv(local))

    def filter(self, volume, data, matrix):
        """The filter that gives the values that Mitsuba finds at some points."""
        points = np.random.default_rng(1).random((64, 3))
        index = np.minimum((points * data.shape[::-1]).astype(int), np.array(data.shape[::-1]) - 1)
        nearest = data[index[:, 2], index[:, 1], index[:, 0]]
        truth = self.at(volume, points @ matrix[:3, :3].T + matrix[:3, 3])
        return "nearest" if np.abs(truth[:, 0] - nearest).max() <= 1e-4 * max(np.abs(data).max(), 1e-30) else "linear"

    def constant(self, volume, what):
        """The value of a volume, three numbers. That of a grid becomes its mean."""
        if kind_of(volume) == "GridVolume":
            data = np.array(parameters(self.mi, volume)["data"], float)
            self.note(f"{what} is a grid; it becomes its mean")
            value = data.reshape(-1, data.shape[3] if data.ndim == 4 else 1).mean(axis=0)
            return np.broadcast_to(value, 3)
        return self.at(volume, np.zeros((1, 3)))[0]

    def at(self, volume, points):
        """The values (N, 3) of a volume at points (N, 3) in the world."""
        import drjit as dr

        if self.mi.variant().startswith("scalar"):
            one, found = dr.zeros(self.mi.Interaction3f), []
            for point in points:
                one.p = self.mi.Point3f(point.tolist())
                found.append(np.broadcast_to(np.array(volume.eval(one), float).ravel(), 3))
            return np.array(found)
        many = dr.zeros(self.mi.Interaction3f, len(points))
        many.p = self.mi.Point3f(*np.array(points.T, np.float32))
        color = volume.eval(many)
        return np.stack([np.broadcast_to(np.array(color[k], float), len(points)) for k in range(3)], axis=-1)

    def phase(self, phase, name):
        """The phase function in the form of glTF files; ``None`` if it is left out, with its medium."""
        kind = "isotropic" if phase is None else kind_of(phase)
        values = {} if phase is None else parameters(self.mi, phase)
        if kind in ("isotropic", "IsotropicPhaseFunction"):
            return {"type": "isotropic"}
        if kind == "HGPhaseFunction":
            return {"type": "hg", "g": self.number(values, "g")}
        if kind == "RayleighPhaseFunction":
            return {"type": "rayleigh"}
        if kind == "TabulatedPhaseFunction":
            table = np.array(values["values"], float).ravel()
            return {"type": "table", "cosines": np.linspace(-1, 1, len(table)).tolist(), "values": table.tolist()}
        if kind == "BlendPhaseFunction":
            parts = [self.phase(child, name) for child in children(self.mi, phase).values() if isinstance(child, self.mi.PhaseFunction)]
            lobes = [{"isotropic": 0.0}.get(part["type"], part.get("g")) if part else None for part in (parts[0], parts[-1])]
            if all(isinstance(g, float) for g in lobes) and "weight.value.value" in values:
                return {"type": "double-hg", "g": lobes, "weight": 1 - self.number(values, "weight.value.value")}
        self.note(f"the medium of '{name}' is left out, because its phase function {kind} is not converted")
        return None


def _are_corners(points):
    """Whether the points are the eight corners of the unit cube."""
    rounded = np.round(points)
    return bool(np.abs(points - rounded).max() < CORNER) and {tuple(point) for point in rounded.astype(int)} == set(np.ndindex(2, 2, 2))


def _axis_box(vertices):
    """Two corners of the box along the axes whose corners are the vertices; ``None`` if there is none."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if not (high > low).all() or not _are_corners((vertices - low) / (high - low)):
        return None
    return low.tolist(), high.tolist()
