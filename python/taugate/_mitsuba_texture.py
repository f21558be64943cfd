"""Textures of Mitsuba 3.

Mitsuba tells the texels of a bitmap, but neither its wrap mode nor its filter, and how it stores texels depends on its version. So
this module evaluates a texture at some points, and chooses the wrap mode, the filter and the decoding that give these values.
"""

import itertools
import re

import numpy as np

from ._texture import MAX_TRANSFORM, ROWS, WRAPS, Texture, blocks, linear_bytes, srgb_bytes, srgb_to_linear

# Textures that depend on nothing but the texture coordinates, and values that are the same everywhere.
EVALUATED = re.compile(r"Bitmap|Checkerboard|\w*Spectrum$")
# Sides in texels of a sampled texture. SIDE also limits how far images are enlarged. Scalar variants evaluate one point at a time.
SIDE, SCALAR_SIDE = 1024, 128
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)


def children(mi, item):
    """The objects that an object consists of, by name. ``mi.traverse`` would list an object only once if two parameters share it."""

    # No reference cycle may hold an object of Mitsuba. The garbage collector would delete the object during a later render of Mitsuba,
    # which ends the process.
    class Children(mi.TraversalCallback):
        def put(self, name, value, flags, cpptype=None):
            if isinstance(value, mi.Object):
                self.put_object(name, value, flags)

        # Versions before 3.9 call these.
        def put_object(self, name, node, flags):
            if node is not None:
                self.found[name] = node

        def put_parameter(self, name, value, flags, cpptype=None):
            pass

        put_value = put_parameter

    callback = Children()
    callback.found = {}
    item.traverse(callback)
    return callback.found


def mix_root(colors, root):
    """The mix of colours and their square roots; `root`: the share of the roots."""
    return (1 - root) * colors + root * np.sqrt(colors) if root else colors


class Textures:
    """Converts the textures of a scene, each one once. `note` takes sentences on what is approximated."""

    def __init__(self, mi, note):
        self.mi = mi
        self.note = note
        # The keys contain addresses (`id`). A value also keeps the object, so no other object gets its address. `exact` keeps the nodes of
        # `sampled`.
        self.exact = {}
        self.sampled = {}
        self.resized = {}
        self.bytes = {}

    def can_convert(self, node):
        """Whether the texture and its nested textures depend on nothing but the texture coordinates."""
        nested = children(self.mi, node).values()
        return bool(EVALUATED.match(node.class_name())) and all(self.can_convert(one) for one in nested)

    def has_valid_transform(self, node):
        """Whether its transform is within the limits of the renderer."""
        found = self.mi.traverse(node)
        return "to_uv" not in found or bool((np.abs(_matrix(found["to_uv"])) <= MAX_TRANSFORM).all())

    def color(self, node, what, uvs, root=0.0):
        """The :class:`Texture` of a colour. `uvs` are the texture coordinates of the mesh; for `root` see :func:`mix_root`."""
        return self.texture(self.image(node, uvs, what), what, self.color_texels, root)

    def roughness(self, node, what, uvs):
        """The :class:`Texture` of the roughness of glTF, the square root of the alpha of GGX."""
        return self.texture(self.image(node, uvs, what), what, self.roughness_texels)

    def numbers(self, nodes, whats, uvs):
        """One :class:`Texture` per node, all of the same shape, with one number from 0 to 1 per texel.

        ``None`` if wrap modes, filters or transforms differ.
        """
        images = self.aligned([self.image(node, uvs, what) for node, what in zip(nodes, whats)])
        return images and [self.texture(image, what, self.number_texels) for image, what in zip(images, whats)]

    def with_alpha(self, texture, node, what, uvs):
        """The texture of a colour, by default white, with the alpha of `node`; ``None`` if wrap modes, filters or transforms differ."""
        alpha = self.image(node, uvs, what)
        key = (id(texture and texture.texels), id(alpha), "alpha")
        if texture is None:
            texture = Texture(np.full((1, 1, 4), 255, np.uint8), alpha.wrap, alpha.filter, alpha.transform)
        color = _Image(texture.texels[..., :3], texture.transform, texture.wrap, texture.filter, True)
        images = self.aligned([color, alpha])
        if images is None:
            return None
        if key not in self.bytes:
            colors, alphas = self.color_texels(images[0], what), self.number_texels(images[1], what)
            self.bytes[key] = (texture, alpha), np.dstack([colors[..., :3], alphas])
        return Texture(self.bytes[key][1], alpha.wrap, alpha.filter, alpha.transform)

    def aligned(self, images):
        """The images, resized to the same number of texels; ``None`` if their wrap modes, filters or transforms differ."""
        for a, b in zip(images, images[1:]):
            if (a.wrap, a.filter) != (b.wrap, b.filter) or not np.allclose(a.transform, b.transform):
                return None
        sizes = {image.texels.shape[:2] for image in images}
        if len(sizes) < 2:
            return images
        # The common size is larger than any image where SIDE allows it. So the edges of texels move little in each image.
        largest = np.max(list(sizes), axis=0)
        size = tuple(int(side) for side in largest * _scale(largest))
        for image in images:
            if (id(image), size) not in self.resized:
                self.resized[id(image), size] = image, image.resized(*size)
        return [self.resized[id(image), size][1] for image in images]

    def mean(self, node):
        """The mean linear colour, three numbers. Values that are not numbers do not count."""
        image = self.image(node, np.array([(0.0, 0.0), (1.0, 1.0)]))
        sums, count = np.zeros(3), np.zeros(3)
        for rows in blocks(image.texels):
            values = image.linear(rows)
            sums = sums + np.nansum(values, axis=(0, 1), dtype=float)
            count = count + (~np.isnan(values)).sum(axis=(0, 1))
        return sums / np.maximum(count, 1)

    def texture(self, image, what, convert, *more):
        """The texture with the bytes that `convert` makes of the image."""
        key = (id(image), convert.__name__, *more)
        if key not in self.bytes:
            self.bytes[key] = image, convert(image, what, *more)
        return Texture(self.bytes[key][1], image.wrap, image.filter, image.transform)

    def color_texels(self, image, what, root=0.0):
        """sRGB bytes (H, W, 4)."""
        bytes = np.full((*image.texels.shape[:2], 4), 255, np.uint8)
        if image.is_srgb and not root:
            bytes[..., :3] = image.texels
            return bytes
        for rows, values in self.clean(image, what):
            bytes[rows, :, :3] = srgb_bytes(mix_root(values, root))
        return bytes

    def roughness_texels(self, image, what):
        """Bytes (H, W)."""
        # taugate interpolates the roughness, and Mitsuba its square. With more texels, the difference is smaller.
        return self.number_texels(image.enlarged(), what, np.sqrt)

    def number_texels(self, image, what, function=np.asarray):
        """Bytes (H, W)."""
        bytes = np.empty(image.texels.shape[:2], np.uint8)
        for rows, values in self.clean(image, what):
            bytes[rows] = linear_bytes(function(values[..., 0] if values.shape[2] == 1 else values @ LUMINANCE))
        return bytes

    def clean(self, image, what):
        """Slices of rows and their linear values, from 0 to 1."""
        lost = clipped = 0
        for rows in blocks(image.texels):
            values = image.linear(rows)
            nan = np.isnan(values)
            lost += np.count_nonzero(nan)
            values = np.where(nan, 0, values)
            # The range of half floats that Mitsuba makes of bytes may end a little above 1.
            clipped += np.count_nonzero((values < 0) | (values > 1.001))
            yield rows, np.clip(values, 0, 1)
        if lost:
            self.note(f"{lost} values of {what} are not numbers; they become 0")
        if clipped:
            self.note(f"{clipped} values of {what} are below 0 or above 1; they are clipped")

    # Images.

    def image(self, node, uvs, what=None):
        """The :class:`_Image` of a texture."""
        if id(node) not in self.exact:
            self.exact[id(node)] = node, self.exact_image(node)
        image = self.exact[id(node)][1]
        if image is not None:
            return image
        low, high = uvs.min(axis=0), uvs.max(axis=0)
        key = (id(node), *low, *high)
        if key not in self.sampled:
            self.sampled[key] = self.sampled_image(node, low, high)
        image = self.sampled[key]
        if what:
            height, width = image.texels.shape[:2]
            self.note(f"{what} is sampled at {width} x {height} points")
        return image

    def exact_image(self, node):
        """The image whose values are those of the texture; ``None`` if there is none."""
        found = self.mi.traverse(node)
        if "to_uv" not in found:
            return None
        matrix = _matrix(found["to_uv"])
        if "data" in found:
            texels = np.asarray(found["data"])[..., :3]
            is_bytes = texels.dtype == np.uint8
            if texels.dtype.kind != "f" and not is_bytes:
                return None
            options = itertools.product(WRAPS, ("linear", "nearest"), (True, False) if is_bytes else (False,))
        else:
            # One period of a checkerboard has four squares.
            corners = np.array([[(0.25, 0.25), (0.75, 0.25)], [(0.25, 0.75), (0.75, 0.75)]])
            texels = self.evaluate(node, _uvs_of(matrix, corners.reshape(-1, 2))).reshape(2, 2, 3)
            options = [("repeat", "nearest", False)]
        # Mitsuba rounds texture coordinates to f32. The lookup below uses the same rounded coordinates.
        uvs = _uvs_of(matrix, _probes(texels)).astype(np.float32).astype(float)
        truth = self.evaluate(node, uvs)
        points = uvs @ matrix[:2, :2].T + matrix[:2, 2]
        images = [_Image(texels, matrix, *option) for option in options]
        errors = [image.error(points, truth) for image in images]
        # The first option within 1e-6 of the smallest error. For example, all wrap modes fit an image of one colour equally well.
        best = int(np.argmax(np.array(errors) <= min(errors) + 1e-6))
        return images[best] if errors[best] < 0.01 else None

    def sampled_image(self, node, low, high):
        """The values of a texture in a box of texture coordinates."""
        side = SCALAR_SIDE if self.mi.variant().startswith("scalar") else SIDE
        size = np.where(high > low, high - low, 1.0)
        rows = []
        # In parts, so that memory stays small.
        for part in np.array_split(np.arange(side), 8):
            v, u = np.meshgrid((part + 0.5) / side, _centres(side), indexing="ij")
            rows.append(self.evaluate(node, low + size * np.stack([u, v], axis=-1).reshape(-1, 2)).reshape(-1, side, 3))
        matrix = np.diag([*(1 / size), 1.0])
        matrix[:2, 2] = -low / size
        return _Image(np.concatenate(rows), matrix, "clamp", "linear", False)

    def evaluate(self, node, uvs):
        """The colours (N, 3) that Mitsuba finds at texture coordinates (N, 2)."""
        import drjit as dr

        if self.mi.variant().startswith("scalar"):
            one = dr.zeros(self.mi.SurfaceInteraction3f)
            colors = []
            for u, v in uvs:
                one.uv = self.mi.Point2f(u, v)
                colors.append(np.array(node.eval(one), np.float32).ravel())
            return np.array(colors)
        many = dr.zeros(self.mi.SurfaceInteraction3f, len(uvs))
        many.uv = self.mi.Point2f(*np.array(uvs.T, np.float32))
        color = node.eval(many)
        return np.stack([np.broadcast_to(np.array(color[k], np.float32), len(uvs)) for k in range(3)], axis=-1)


class _Image:
    """Texels (H, W, C), and where they are."""

    def __init__(self, texels, transform, wrap, filter, is_srgb):
        self.texels = texels
        self.transform = transform
        self.wrap = wrap
        self.filter = filter
        self.is_srgb = is_srgb

    def linear(self, index):
        """Linear values of texels."""
        texels = self.texels[index]
        if self.is_srgb:
            return srgb_to_linear(texels)
        return texels.astype(np.float32) / np.float32(255 if texels.dtype == np.uint8 else 1)

    def error(self, points, truth):
        """Mean difference to the true values at points of the image, relative to the largest true value."""
        # Texels and transforms may be NaN.
        with np.errstate(invalid="ignore"):
            values = np.broadcast_to(self.lookup(points), truth.shape)
        known = np.isfinite(truth) & np.isfinite(values)
        scale = np.abs(truth[known]).max(initial=1e-9)
        return np.minimum(np.abs(values[known] - truth[known]) / scale, 1).sum() / max(np.count_nonzero(known), 1)

    def lookup(self, points):
        """The filtered values at points of the image, (0, 0) at the top left and (1, 1) at the bottom right."""
        size = np.array(self.texels.shape[1::-1])
        place = points * size
        if self.filter == "nearest":
            return self.texel(np.floor(place).astype(int), size)
        base = np.floor(place - 0.5).astype(int)
        part = place - 0.5 - base
        total = 0
        for step in itertools.product((0, 1), repeat=2):
            weights = np.where(step, part, 1 - part).prod(axis=1)
            total = total + weights[:, None] * self.texel(base + step, size)
        return total

    def enlarged(self):
        """The same image, its sides multiplied by :func:`_scale`. With the filter ``nearest``, the image itself."""
        height, width = self.texels.shape[:2]
        scale = _scale((height, width))
        return self if self.filter == "nearest" else self.resized(scale * height, scale * width)

    def resized(self, height, width):
        """The same image with this number of texels."""
        if (height, width) == self.texels.shape[:2]:
            return self
        rows = []
        for part in np.array_split(_centres(height), -(-height // ROWS)):
            v, u = np.meshgrid(part, _centres(width), indexing="ij")
            rows.append(self.lookup(np.stack([u, v], axis=-1).reshape(-1, 2)).reshape(len(part), width, -1).astype(np.float32))
        return _Image(np.concatenate(rows), self.transform, self.wrap, self.filter, False)

    def texel(self, index, size):
        if self.wrap == "clamp":
            index = np.clip(index, 0, size - 1)
        elif self.wrap == "repeat":
            index = index % size
        else:
            index = index % (2 * size)
            index = np.minimum(index, 2 * size - 1 - index)
        return self.linear((index[:, 1], index[:, 0]))


def _probes(texels):
    """Points of an image at which filters, wrap modes and decodings differ."""
    random = np.random.default_rng(1)
    points = random.uniform(-1.5, 2.5, (256, 2))
    # Adds points on texels that differ from the first texel, in the image and in its repeated or mirrored copies. Random points may all
    # lie in a uniform part.
    rows = [row for row, line in enumerate(texels) if (line != texels[0, 0]).any()]
    for row in random.choice(rows, 256) if rows else ():
        column = random.choice(np.flatnonzero((texels[row] != texels[0, 0]).any(axis=-1)))
        point = (np.array([column, row]) + random.uniform(0.2, 0.8, 2)) / texels.shape[1::-1]
        sign, shift = random.choice([1, -1], 2), random.choice([-1, 0, 1], 2)
        points = np.vstack([points, np.where(sign > 0, point + shift, 1 + shift - point)])
    return points


def _scale(size):
    """Factor from 1 to 8 that keeps the sides of an image within ``SIDE`` texels. It is 1 for a larger image."""
    return max(1, min(8, SIDE // max(size)))


def _centres(count):
    """Centres of texels along a side of the image."""
    return (np.arange(count) + 0.5) / count


def _uvs_of(matrix, points):
    """Texture coordinates of points of the image. If the transform flattens the image, the points themselves."""
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-12:
        return points
    return (points - matrix[:2, 2]) @ np.linalg.inv(matrix[:2, :2]).T


def _matrix(transform):
    """The 3 x 3 matrix of a transform of texture coordinates."""
    return np.array(transform.matrix, float).reshape(3, 3)
