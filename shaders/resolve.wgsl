// Computes the mean over the samples of each pixel, and adds up the counts of the tile's paths.
#import math
#import samples

// xyz: radiance of each path. With MERGES, w: luminance of the merged light in it.
@group(2) @binding(0) var<storage, read> radiance: array<vec4<f32>>;
// Counts per path, see gather.wgsl.
@group(2) @binding(1) var<storage, read> tallies: array<vec4<u32>>;
// One entry per pixel of the crop, row-major. xyz: mean of the samples. w: sum of their squared luminances.
@group(2) @binding(2) var<storage, read_write> film: array<vec4<f32>>;
// The host reads these words anyway, so it reads the sums of the tallies with them. The array has a fixed size, because naga cannot check
// indices of atomics in others (TAUGATE_BOUNDS_CHECKS).
@group(2) @binding(3) var<storage, read_write> counters: array<atomic<u32>, COUNTER_TALLIES + 4u>;

// With MERGES, per pixel of the crop: mean luminance of the merged light.
@group(2) @binding(4) var<storage, read_write> merged_film: array<f32>;
// The pixels of the tile, see list_samples.wgsl.
@group(2) @binding(5) var<storage, read> tile_pixels: array<vec2<u32>>;

// Number of paths whose tallies one thread sums, so that few threads add to the same words.
const TALLIED_PATHS: u32 = 32u;

// One thread adds up the samples of one pixel of the tile, and the tallies of TALLIED_PATHS paths. There may be more threads than pixels,
// or more than such groups of paths.
@compute @workgroup_size(WORKGROUP)
fn resolve(@builtin(global_invocation_id) id: vec3<u32>) {
    let path = id.x * TALLIED_PATHS;
    if (path < dispatch.count) {
        sum_tallies(path);
    }
    if (id.x < dispatch.rank) {
        average(tile_pixels[id.x], tile_pixels[id.x + 1u].y);
    }
}

// Writes the mean of the samples of a pixel of the tile, which end before `end`.
fn average(pixel: vec2<u32>, end: u32) {
    let first = pixel.y;
    var sum = vec3<f32>(0.0);
    var squares = 0.0;
    var merged = 0.0;
    // The loop exits at its top: SwiftShader loses the last iteration of a loop that exits at its end (src/gpu/quirks.rs).
    for (var path = first; path < end; path++) {
        let r = radiance[path].xyz;
        let counted = select(vec3<f32>(0.0), r, is_finite(r));
        sum += counted;
        if (!SPLITS_AT_SHEETS) {
            squares += square(luminance(counted));
        }
        if (MERGES) {
            merged += select(0.0, radiance[path].w, is_finite(r));
        }
    }
    if (SPLITS_AT_SHEETS) {
        squares = squares_of_pairs(first, end - first);
    }
    let index = crop_index(pixel.x);
    film[index] = vec4<f32>(sum / f32(end - first), squares);
    if (MERGES) {
        merged_film[index] = merged / f32(end - first);
    }
}

// Sum of the squared luminances of the samples that pass thin glass, each with a sample that stops there. `count`: number of all samples
// of the pixel, whose first one is `first`.
fn squares_of_pairs(first: u32, count: u32) -> f32 {
    let passing = passing_samples(count);
    let stopping = count - passing;
    var sum = 0.0;
    for (var k = 0u; k < passing; k++) {
        let passed = radiance[first + k].xyz * (f32(passing) / f32(count));
        let stopped = radiance[first + passing + k % stopping].xyz * (f32(stopping) / f32(count));
        let both = passed + stopped;
        sum += select(0.0, square(luminance(both)), is_finite(both));
    }
    return sum;
}

// Adds the tallies of TALLIED_PATHS paths to `counters`. Sums of integers do not depend on the order of the threads. They fit 32 bits:
// a dispatch over all candidate slots has at most 65,535 workgroups, and there are at most 254 bounces.
fn sum_tallies(first: u32) {
    var sum = vec4<u32>(0u);
    let end = min(first + TALLIED_PATHS, dispatch.count);
    for (var path = first; path < end; path++) {
        // A sample whose sum is not finite is dropped too.
        sum += tallies[path] + vec4<u32>(select(1u, 0u, is_finite(radiance[path].xyz)), 0u, 0u, 0u);
    }
    atomicAdd(&counters[COUNTER_TALLIES], sum.x);
    atomicAdd(&counters[COUNTER_TALLIES + 1u], sum.y);
    atomicAdd(&counters[COUNTER_TALLIES + 2u], sum.z);
    atomicAdd(&counters[COUNTER_TALLIES + 3u], sum.w);
}
