"""Points of a LiDAR scan: python3 examples/lidar_points.py SCAN.npy POINTS.ply (needs numpy)

Each beam has one point per echo in its histogram. Peaks are searched in the light of all gates within --distance. Two peaks are two
echoes if the light between them falls below half of the lower one, by more than the noise, and if they lie --distance apart. So a
slanted wall is one echo. An echo that begins before the first gate, such as light that fog scatters near the laser, is left out.
--range says where in its echo a point lies: at the centre of the light, at the brightest gate, or where the light first rises to half of its
maximum. Distances are those in a medium of index 1. Noise is that of counts (taugate detect), or is taken from SCAN.variance.npy
(taugate render --variance) if it exists, and else estimated.

POINTS.ply, .las (1.4, for GIS programs) and .npy have the fields x, y, z, intensity, echo (counted from 1), echoes (of the beam), time (of
the shot in seconds), channel (its number in the step or row) and object_id. The intensity of a white diffuse target at 1 m that faces the
laser is 1, so that of other targets falls with the square of the distance; in .las it is multiplied by this square, and 65535 is
white. Intensities of counts are counts. object_id is the number of the object with SCAN.aov.npy (--aov object,depth), for echoes at the surface
on the axis of the beam, else 0.
"""

import argparse
import json
import pathlib
import struct

import numpy

BLOCK = 4096
FIELDS = [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("intensity", "<f4"), ("echo", "u1"), ("echoes", "u1"), ("time", "<f8"), ("channel", "<u2"), ("object_id", "<u4")]
PLY_TYPES = {"<f8": "double", "<f4": "float", "u1": "uchar", "<u2": "ushort", "<u4": "uint"}
KEEP = {
    "all": lambda found: found,
    "strongest": lambda found: [max(found, key=lambda echo: echo[1])],
    "last": lambda found: [found[-1]],
    "first-and-last": lambda found: found[:1] + found[1:][-1:],
}


def noise_of(light, samples, variance, is_counts=False):
    """Standard error of each value (gates x beams). Without variances: as if the light nearby came from all samples, equally bright."""
    sums = numpy.concatenate([numpy.zeros((1, light.shape[1])), light.cumsum(axis=0)])
    gates = numpy.arange(len(light))
    nearby = sums[numpy.minimum(gates + 21, len(light))] - sums[numpy.maximum(gates - 20, 0)]
    if is_counts:
        return numpy.sqrt(numpy.maximum(light, nearby / 41))
    square = light * nearby / samples
    return numpy.sqrt(square if variance is None else numpy.maximum(square, variance))


def histograms(light, variance, samples, is_counts):
    """The light of each beam and its standard errors. Reads a block of beams at a time."""
    for begin in range(0, light.shape[1], BLOCK):
        # Beams that an interrupt left out have no light.
        block, errors = (None if a is None else numpy.nan_to_num(a[:, begin : begin + BLOCK].astype(float)) for a in (light, variance))
        yield from zip(block.T, noise_of(block, samples, errors, is_counts).T)


def edge(own, around, rule):
    """Where an echo with the light `own` is, in gates from the centre of its first gate. `around`: also the gates before and after it."""
    if rule == "centre":
        return (own * numpy.arange(len(own))).sum() / own.sum()
    top = int(numpy.argmax(own))
    before, at, after = around[top : top + 3]
    if rule == "peak":
        # The vertex of the parabola through the brightest gate and its neighbours.
        bend = before - 2 * at + after
        return top + (0.5 * (before - after) / bend if bend < 0 else 0)
    # The light rises on straight lines between the centres of the gates.
    rise = int(numpy.flatnonzero(own >= 0.5 * at)[0])
    low, high = min(around[rise], 0.5 * at), own[rise]
    return rise - 1 + (0.5 * at - low) / (high - low)


def echoes(light, errors, apart, sigmas, rule="centre"):
    """The echoes of a beam, the earliest first: pairs of the position in gates and of the light. `apart`: minimum distance in gates."""
    near = numpy.ones(2 * min(int(apart / 2), (len(light) - 1) // 2) + 1)
    seen = numpy.convolve(light, near, "same")
    noise = numpy.sqrt(numpy.convolve(errors**2, near, "same"))
    around = numpy.concatenate([[0], seen, [0]])
    tops = numpy.flatnonzero((seen > around[:-2]) & (seen >= around[2:]))
    if len(tops) == 0:
        return []
    valleys = [a + int(numpy.argmin(seen[a:b])) for a, b in zip(tops, tops[1:])]
    # Join the sides of one valley after the other, the shallowest first. The lower top ends there, unless the valley is deep.
    top_of, separate = list(tops), {int(tops[numpy.argmax(seen[tops])])}
    side = list(range(len(tops)))

    def root(number):
        while side[number] != number:
            number = side[number]
        return number

    for left in sorted(range(len(valleys)), key=lambda number: -seen[valleys[number]]):
        a, b = root(left), root(left + 1)
        low, high = (a, b) if seen[top_of[a]] < seen[top_of[b]] else (b, a)
        top, valley = top_of[low], valleys[left]
        depth = seen[top] - seen[valley]
        if depth > 0.5 * seen[top] and depth > sigmas * numpy.hypot(noise[top], noise[valley]):
            separate.add(int(top))
        side[low] = high
    kept = []
    for top in sorted(separate, key=lambda top: -seen[top]):
        if all(abs(top - other) >= apart for other in kept):
            kept.append(top)
    kept.sort()
    # Each echo ends where the light between it and the next one is least.
    ends = [0, *(a + int(numpy.argmin(seen[a:b])) for a, b in zip(kept, kept[1:])), len(seen)]
    found = []
    for top, begin, end in zip(kept, ends, ends[1:]):
        if begin == 0 and seen[0] > 0.5 * seen[top]:
            continue
        # Light that is there before or after the echo, such as that of fog, is not its own.
        last = min(end, len(seen) - 1)
        ground = max(seen[begin], seen[last] if end < len(seen) else 0)
        mean = numpy.maximum(seen[begin : last + 1] - ground, 0)
        # The echo is where the light of nearby gates is at least half of its maximum.
        dark = begin + numpy.flatnonzero(mean < 0.5 * mean.max())
        first = dark[dark < top][-1] + 1 if (dark < top).any() else begin
        past = dark[dark > top][0] if (dark > top).any() else last + 1
        gates = numpy.arange(first, past)
        own = numpy.maximum(light[gates] - ground / len(near), 0)
        if own.sum() > sigmas * numpy.sqrt((errors[gates][own > 0] ** 2).sum()):
            around = numpy.maximum(numpy.pad(light, 1)[first : past + 2] - ground / len(near), 0)
            found.append((first + edge(own, around, rule), own.sum()))
    return found


def main():
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("scan")
    words.add_argument("points")
    words.add_argument("--keep", choices=KEEP, default="all", help="the echoes of each beam that become points (default: all)")
    words.add_argument("--echoes", type=int, default=8, help="greatest number of echoes of a beam, the earliest ones (default: 8)")
    words.add_argument("--range", choices=["centre", "peak", "constant-fraction"], default="centre", help="where in its echo a point lies (default: centre)")
    words.add_argument("--distance", type=float, default=0.5, help="least distance in m between two echoes (default: 0.5)")
    words.add_argument("--sigmas", type=float, default=3, help="least height of a peak in standard errors (default: 3)")
    wanted = words.parse_args()
    path, output = pathlib.Path(wanted.scan), pathlib.Path(wanted.points)
    contents = {".ply": lambda points, _: ply(points), ".las": las, ".npy": None}
    if output.suffix not in contents or output.absolute() == path.absolute():
        raise SystemExit(f"{output} must end in .ply, .las or .npy, and must not be the scan")
    light = numpy.load(path, mmap_mode="r")  # gates x beams
    about = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    if light.ndim != 2 or "bin_width_opl" not in about:
        raise SystemExit(f"{path} is no scan of beams with gates of one width")
    if not about.get("account_first_and_last_bounces") or about.get("sensor", about["laser"]) != about["laser"]:
        raise SystemExit(f"{path} is no scan of a LiDAR: its travel times must begin and end at the laser")
    variances = path.with_suffix(".variance.npy")
    variance = numpy.load(variances, mmap_mode="r") if variances.exists() else None
    is_counts = "detector" in about
    if variance is None and not is_counts:
        print(f"note: there is no {variances}, so the noise is estimated; with fog, render with --variance")
    beams = numpy.array(about["laser_points"], float)
    # A LiDAR on a car has another place at each shot.
    places = numpy.broadcast_to(numpy.array(about.get("laser_places", about["laser"]), float), beams.shape)
    times = about.get("shot_times_s", numpy.zeros(len(beams)))
    channels = (about.get("laser_grid") or [len(beams)])[0]
    white = 1 if is_counts else about.get("white_target_at_1m", 1)
    beams -= places
    beams /= numpy.linalg.norm(beams, axis=1, keepdims=True)
    start, width = 0.5 * about["start_opl"], 0.5 * about["bin_width_opl"]
    layers = path.with_suffix(".aov.npy")
    axis = numpy.load(layers) if {"range", "object_id"} <= set(about.get("aov", [])) and layers.exists() else None
    rows, ranges = [], []
    for number, (beam, (seen, errors)) in enumerate(zip(beams, histograms(light, variance, about["samples"], is_counts))):
        found = echoes(seen, errors, wanted.distance / width, wanted.sigmas, wanted.range)[: wanted.echoes]
        for echo in KEEP[wanted.keep](found) if found else []:
            depth = start + width * (echo[0] + 0.5)
            is_axis = axis is not None and abs(axis["range"][number] - depth) < wanted.distance
            object_id = axis["object_id"][number] if is_axis else 0
            place = places[number] + depth * beam
            rows.append((*place, echo[1] / white, found.index(echo) + 1, len(found), times[number], number % channels, object_id))
            ranges.append(depth)
    points = numpy.array(rows, FIELDS)
    if output.suffix == ".npy":
        numpy.save(output, points)
    else:
        output.write_bytes(contents[output.suffix](points, ranges))
    print(f"{output}: {len(points)} points of {len(beams)} beams")


def ply(points):
    """A binary PLY file."""
    fields = "".join(f"property {PLY_TYPES[kind]} {name}\n" for name, kind in FIELDS)
    return f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n{fields}end_header\n".encode() + points.tobytes()


def las(points, ranges):
    """A LAS 1.4 file of point format 6, in tenths of a millimetre."""
    places = numpy.stack([points[name] for name in "xyz"])
    low, high = (places.min(axis=1), places.max(axis=1)) if len(points) else (numpy.zeros(3), numpy.zeros(3))
    scale, offset = 1e-4, numpy.floor(low)
    record = [("x", "<i4"), ("y", "<i4"), ("z", "<i4"), ("intensity", "<u2"), ("returns", "u1"), ("flags", "u1"), ("class", "u1")]
    record += [("user", "u1"), ("angle", "<i2"), ("source", "<u2"), ("time", "<f8")]
    out = numpy.zeros(len(points), record)
    for name, values, begin in zip("xyz", places, offset):
        out[name] = numpy.round((values - begin) / scale)
    reflected = points["intensity"] * numpy.array(ranges) ** 2
    out["intensity"] = numpy.round(65535 * numpy.clip(reflected, 0, 1))
    out["returns"] = numpy.minimum(points["echo"], 15) | numpy.minimum(points["echoes"], 15) << 4
    out["source"], out["time"] = points["channel"], points["time"]
    by_return = numpy.bincount(numpy.minimum(points["echo"], 15), minlength=16)[1:]
    header = struct.pack("<4sHH16sBB32s32sHHHII", b"LASF", 0, 16, b"", 1, 4, b"taugate", b"lidar_points.py", 0, 0, 375, 375, 0)
    header += struct.pack("<BHI5I", 6, out.itemsize, 0, *[0] * 5) + struct.pack("<6d", *[scale] * 3, *offset)
    header += struct.pack("<6d", *numpy.stack([high, low], axis=1).ravel())
    return header + struct.pack("<QQIQ15Q", 0, 0, 0, len(points), *by_return) + out.tobytes()


if __name__ == "__main__":
    main()
