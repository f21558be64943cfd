// Adds light that reaches the sensor to the images of several responses, if they are on the device (render/responses/on_device.rs).
// Each pixel adds its light in the order in which the host would: splats first, then bounce by bounce the list of s = 0, the connections,
// and the light of photons. A dispatch adds one list. The sums are f64, as those of the host, so they have the same bits.
#import candidate
#import math
#import samples
#import observed

// When the gate of each response begins and ends, in units of the render space. The gates ascend and do not overlap.
@group(2) @binding(0) var<storage, read> gates: array<vec2<f32>>;
// Sums of the present iteration: R, G, B by pixel and response, the pixel slowest.
@group(2) @binding(1) var<storage, read_write> present: array<f64>;
@group(2) @binding(2) var<storage, read> counters: array<u32>;

// Adds the entries of a list in `observed`. One thread looks at one element of the list, which has `dispatch.rank` entries. In the list the
// pixels ascend, and the thread of a pixel's first element adds all of them.
@compute @workgroup_size(WORKGROUP)
fn add_arrivals(@builtin(global_invocation_id) id: vec3<u32>) {
    let count = counters[dispatch.counter];
    if (id.x >= count) {
        return;
    }
    let pixel = pixel_at(id.x);
    if (id.x > 0u && pixel_at(id.x - 1u) == pixel) {
        return;
    }
    // Rounded as on the host: Vulkan does not require that of divisions of f32.
    let share = f32(1.0lf / f64(samples_of_pixel(path_at(id.x))));
    let place = dispatch.first + crop_index(pixel);
    for (var element = id.x; element < count && pixel_at(element) == pixel; element++) {
        for (var k = 0u; k < dispatch.rank; k++) {
            let entry = observed[element * dispatch.rank + k];
            // The detail of a connection without a shadow ray is NOT_TRACED. Light that is not finite counts as dropped elsewhere.
            let light = vec3<f32>(entry.red, entry.green, entry.blue) * share;
            if (entry.detail > NOT_TRACED && is_finite(light)) {
                add(place, entry.detail, light);
            }
        }
    }
}

// Adds `dispatch.count` splats (t = 1) in `observed`, whose paths are indices of pixels and ascend.
@compute @workgroup_size(WORKGROUP)
fn add_splats(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var first = id.x; first < dispatch.count; first += WORKGROUP * groups.x) {
        let pixel = observed[first].path;
        if (first > 0u && observed[first - 1u].path == pixel) {
            continue;
        }
        for (var at = first; at < dispatch.count && observed[at].path == pixel; at++) {
            let splat = observed[at];
            add(pixel, splat.detail, vec3<f32>(splat.red, splat.green, splat.blue));
        }
    }
}

// The path of an element of the list.
fn path_at(element: u32) -> u32 {
    return observed[element * dispatch.rank].path & ((1u << PATH_BITS) - 1u);
}

// The pixel of an element of the list, as in `tile_samples`.
fn pixel_at(element: u32) -> u32 {
    return tile_samples[path_at(element)].x;
}

// Adds light with travel time `tau` to the response that sees it, in the pixel with index `pixel` in the film.
fn add(pixel: u32, tau: f32, light: vec3<f32>) {
    // If travel times omit the ways to a wall, rounding or the field of view of a pixel may make them slightly negative.
    let time = max(tau, 0.0);
    // Number of gates that begin at or before `time`.
    var begun = 0u;
    var end = dispatch.list_a;
    for (; begun < end;) {
        let middle = (begun + end) / 2u;
        if (gates[middle].x <= time) {
            begun = middle + 1u;
        } else {
            end = middle;
        }
    }
    if (begun == 0u || time >= gates[begun - 1u].y) {
        return;
    }
    let at = 3u * (pixel * dispatch.list_a + begun - 1u);
    present[at] += f64(light.x);
    present[at + 1u] += f64(light.y);
    present[at + 2u] += f64(light.z);
}
