#!/usr/bin/env python3
"""Measures what a farm of machines costs, and simulates farms of 10 to 10,000 workers.

    python3 benches/farm.py [--seconds 10] [--resolution 512]

Needs the Python module with its extra farm (pip install "./python[farm]"). Nothing else may run on the machine. It prints three results:
the time of a render by one process and by a farm of one worker, in turns; the size of a part, and the time to read and add it; and the
simulation. In the simulation, one client receives and adds the parts one after the other.
"""

import argparse
import heapq
import pathlib
import random
import statistics
import time

import distributed
import taugate
from taugate import _native, farm

ROOT = pathlib.Path(__file__).resolve().parents[1]
#: Networks in bytes per second: 1 and 10 Gbit/s.
NETWORKS = {"1 Gbit/s": 1.25e8, "10 Gbit/s": 1.25e9}


def compare(scene, settings, seconds, pairs):
    """Seconds of a render by this process and by a farm of one worker, in turns, for the same samples."""
    probe = taugate.render(scene, spp=16, **settings)
    spp = max(16, round(3 * seconds * 16 / probe.seconds / 8) * 8)
    times = {"render": [], "farm": []}
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster, distributed.Client(cluster) as client:
        farm.render(scene, client=client, spp=16, **settings)
        for _ in range(pairs):
            for name in times:
                started = time.perf_counter()
                if name == "render":
                    taugate.render(scene, spp=spp, **settings)
                else:
                    farm.render(scene, client=client, spp=spp, part_seconds=seconds, **settings)
                times[name].append(time.perf_counter() - started)
    ratios = [b / a for a, b in zip(times["render"], times["farm"])]
    print(f"{spp} samples: render {statistics.median(times['render']):.1f} s, farm of one worker {statistics.median(times['farm']):.1f} s")
    print(f"ratio {statistics.median(ratios):.3f} ({min(ratios):.3f} to {max(ratios):.3f}), {pairs} pairs in turns, parts of {seconds} s")


def measure(scene, settings):
    """Bytes of a part, and seconds to read and add one."""
    native, flags = scene._job(settings, "farm.render")
    parts = [_native.accumulate(native, flags, "x", k, k + 1, None) for k in range(4)]
    total = _native.Sums.from_bytes(parts[0])
    started = time.perf_counter()
    for part in parts[1:]:
        total.merge(_native.Sums.from_bytes(part))
    return len(parts[0]), (time.perf_counter() - started) / (len(parts) - 1)


def simulate(workers, part_seconds, service, parts_per_worker=20, spread=0.1):
    """Parts per second of a farm, relative to workers that never wait. Each worker has two parts: one runs, one waits. The client adds one part
    at a time and then sends a new one. A part takes `part_seconds`, with a log-normal spread."""
    random.seed(1)
    draw = lambda: part_seconds * random.lognormvariate(0, spread)
    total = workers * parts_per_worker
    # A worker begins its next part at once if one was sent to it.
    queue = [farm.AHEAD - 1] * workers
    events = [(draw(), worker) for worker in range(workers)]
    heapq.heapify(events)
    idle, client_free, done, now = [], 0.0, 0, 0.0
    while done < total:
        now, worker = heapq.heappop(events)
        if worker < 0:
            # The client has added a part. It sends a new one to an idle worker, else to the worker with the fewest parts (of many workers: to any).
            done += 1
            if idle:
                heapq.heappush(events, (now + draw(), idle.pop()))
            else:
                queue[min(range(workers), key=queue.__getitem__) if workers <= 200 else random.randrange(workers)] += 1
            continue
        client_free = max(client_free, now) + service
        heapq.heappush(events, (client_free, -1))
        if queue[worker] > 0:
            queue[worker] -= 1
            heapq.heappush(events, (now + draw(), worker))
        else:
            idle.append(worker)
    return done / now / (workers / part_seconds)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--resolution", type=int, default=512)
    parser.add_argument("--pairs", type=int, default=3)
    arguments = parser.parse_args()
    settings = dict(gate="5m..6m", resolution=(arguments.resolution, arguments.resolution))
    scene = taugate.load(ROOT / "scenes/cornell-box.glb")
    compare(scene, settings, arguments.seconds, arguments.pairs)
    size, merge = measure(scene, settings)
    print(f"a part has {size / 1e6:.1f} MB; reading and adding it takes {1e3 * merge:.0f} ms")
    for network, speed in NETWORKS.items():
        service = size / speed + merge
        print(f"\n{network}: receiving and adding a part takes {service:.3f} s. Share of the workers' time that is used:")
        print("| workers | " + " | ".join(f"parts of {seconds} s" for seconds in (10, 60, 600)) + " |")
        print("|---|---|---|---|")
        for workers in (10, 30, 100, 300, 1000, 3000, 10000):
            shares = [simulate(workers, seconds, service) for seconds in (10.0, 60.0, 600.0)]
            print(f"| {workers} | " + " | ".join(f"{100 * share:.0f} %" for share in shares) + " |", flush=True)


if __name__ == "__main__":
    main()
