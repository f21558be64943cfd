// The images of several responses on the device (render/responses/on_device.rs): adds an iteration to them, or clears them. The values are
// R, G, B by pixel and response, the pixel slowest. Dispatches have at most as many threads as a device allows, so threads take turns.
#import frame

// Sums of the present iteration; 0 between two iterations.
@group(2) @binding(0) var<storage, read_write> present: array<f64>;
// Sums of w x over the iterations, where x is the value of one with w samples per pixel.
@group(2) @binding(1) var<storage, read_write> sums: array<f64>;
// Sums of w x^2. Not used if `dispatch.counter` is 0.
@group(2) @binding(2) var<storage, read_write> squares: array<f64>;
// The sum over all responses in the present iteration: R, G, B by pixel.
@group(2) @binding(3) var<storage, read_write> total: array<f32>;

// Sums the responses of `dispatch.count` pixels, `dispatch.list_a` in each.
@compute @workgroup_size(WORKGROUP)
fn total_responses(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var pixel = id.x; pixel < dispatch.count; pixel += WORKGROUP * groups.x) {
        var red = f64();
        var green = f64();
        var blue = f64();
        for (var response = 0u; response < dispatch.list_a; response++) {
            let at = 3u * (pixel * dispatch.list_a + response);
            red += present[at];
            green += present[at + 1u];
            blue += present[at + 2u];
        }
        total[3u * pixel] = f32(red);
        total[3u * pixel + 1u] = f32(green);
        total[3u * pixel + 2u] = f32(blue);
    }
}

// Adds `dispatch.count` values of an iteration with `dispatch.rank` samples per pixel.
@compute @workgroup_size(WORKGROUP)
fn add_responses(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let weight = f64(dispatch.rank);
    for (var at = id.x; at < dispatch.count; at += WORKGROUP * groups.x) {
        let x = present[at];
        sums[at] += weight * x;
        if (dispatch.counter != 0u) {
            squares[at] += weight * x * x;
        }
        present[at] = f64();
    }
}

// Clears `dispatch.count` values of the present iteration.
@compute @workgroup_size(WORKGROUP)
fn clear_present(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var at = id.x; at < dispatch.count; at += WORKGROUP * groups.x) {
        present[at] = f64();
    }
}

// Clears `dispatch.count` values of all iterations.
@compute @workgroup_size(WORKGROUP)
fn clear_sums(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var at = id.x; at < dispatch.count; at += WORKGROUP * groups.x) {
        sums[at] = f64();
        if (dispatch.counter != 0u) {
            squares[at] = f64();
        }
    }
}
