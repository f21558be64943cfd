"""Points of a LiDAR scan: python3 examples/lidar_points.py SCAN.npy POINTS.ply (needs numpy)

Each beam has one point per echo in its histogram, at the centre of the echo's light. Peaks are searched in the light of all gates within
--distance. Two peaks are two echoes if the light between them falls below half of the lower one, by more than the noise, and if they lie
--distance apart. So a slanted wall is one echo. An echo that begins before the first gate, such as light that fog scatters near the
laser, is left out. Distances are those in a medium of index 1. Noise is taken from SCAN.variance.npy (taugate render --variance), if it exists, and else estimated.

The file has the fields x, y, z, intensity, echo (counted from 1) and echoes (of the beam). CloudCompare, MeshLab and Blender open it.
With a duration, time is that of the shot in seconds. With SCAN.aov.npy (--aov object,depth), object_id is the number of the object, for echoes at the surface on the axis of the beam, else 0.
"""

import argparse
import json
import pathlib

import numpy

BLOCK = 4096
KEEP = {
    "all": lambda found: found,
    "strongest": lambda found: [max(found, key=lambda echo: echo[1])],
    "last": lambda found: [found[-1]],
    "first-and-last": lambda found: found[:1] + found[1:][-1:],
}


def noise_of(light, samples, variance):
    """Standard error of each value (gates x beams). Without variances: as if the light nearby came from all samples, equally bright."""
    sums = numpy.concatenate([numpy.zeros((1, light.shape[1])), light.cumsum(axis=0)])
    gates = numpy.arange(len(light))
    nearby = sums[numpy.minimum(gates + 21, len(light))] - sums[numpy.maximum(gates - 20, 0)]
    square = light * nearby / samples
    return numpy.sqrt(square if variance is None else numpy.maximum(square, variance))


def histograms(light, variance, samples):
    """The light of each beam and its standard errors. Reads a block of beams at a time."""
    for begin in range(0, light.shape[1], BLOCK):
        # Beams that an interrupt left out have no light.
        block, errors = (None if a is None else numpy.nan_to_num(a[:, begin : begin + BLOCK].astype(float)) for a in (light, variance))
        yield from zip(block.T, noise_of(block, samples, errors).T)


def echoes(light, errors, apart, sigmas):
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
            found.append(((own * gates).sum() / own.sum(), own.sum()))
    return found


def main():
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("scan")
    words.add_argument("points")
    words.add_argument("--keep", choices=KEEP, default="all", help="the echoes of each beam that become points (default: all)")
    words.add_argument("--distance", type=float, default=0.5, help="least distance in m between two echoes (default: 0.5)")
    words.add_argument("--sigmas", type=float, default=3, help="least height of a peak in standard errors (default: 3)")
    wanted = words.parse_args()
    path = pathlib.Path(wanted.scan)
    light = numpy.load(path, mmap_mode="r")  # gates x beams
    about = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    if light.ndim != 2 or "bin_width_opl" not in about:
        raise SystemExit(f"{path} is no scan of beams with gates of one width")
    if not about.get("account_first_and_last_bounces") or about.get("sensor", about["laser"]) != about["laser"]:
        raise SystemExit(f"{path} is no scan of a LiDAR: its travel times must begin and end at the laser")
    variances = path.with_suffix(".variance.npy")
    variance = numpy.load(variances, mmap_mode="r") if variances.exists() else None
    if variance is None:
        print(f"note: there is no {variances}, so the noise is estimated; with fog, render with --variance")
    beams = numpy.array(about["laser_points"], float)
    # A LiDAR on a car has another place at each shot.
    places = numpy.broadcast_to(numpy.array(about.get("laser_places", about["laser"]), float), beams.shape)
    times = about.get("shot_times_s")
    beams -= places
    beams /= numpy.linalg.norm(beams, axis=1, keepdims=True)
    start, width = 0.5 * about["start_opl"], 0.5 * about["bin_width_opl"]
    layers = path.with_suffix(".aov.npy")
    axis = numpy.load(layers) if {"range", "object_id"} <= set(about.get("aov", [])) else None
    rows = []
    for number, (beam, (seen, errors)) in enumerate(zip(beams, histograms(light, variance, about["samples"]))):
        found = echoes(seen, errors, wanted.distance / width, wanted.sigmas)
        for echo in KEEP[wanted.keep](found) if found else []:
            depth = start + width * (echo[0] + 0.5)
            row = (*(places[number] + depth * beam), echo[1], found.index(echo) + 1, len(found))
            if times is not None:
                row += (times[number],)
            if axis is not None:
                is_axis = abs(axis["range"][number] - depth) < wanted.distance
                row += (axis["object_id"][number] if is_axis else 0,)
            rows.append(row)
    header = f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\n"
    header += "".join(f"property float {name}\n" for name in ["x", "y", "z", "intensity"])
    header += "property uchar echo\nproperty uchar echoes\n"
    header += "" if times is None else "property double time\n"
    header += "" if axis is None else "property uint object_id\n"
    form = "%.4f %.4f %.4f %.6g %d %d" + ("" if times is None else " %.9f") + ("" if axis is None else " %d")
    text = numpy.array(rows).reshape(-1, len(form.split()))
    numpy.savetxt(wanted.points, text, fmt=form, header=header + "end_header", comments="")
    print(f"{wanted.points}: {len(rows)} points of {len(beams)} beams")


if __name__ == "__main__":
    main()
