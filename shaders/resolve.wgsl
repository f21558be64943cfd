// Computes the mean over the samples of each pixel.
#import math
#import samples

@group(2) @binding(0) var<storage, read> radiance: array<vec4<f32>>;
@group(2) @binding(1) var<storage, read> tallies: array<vec4<u32>>;
// One entry per pixel of the crop, row-major. xyz: mean of the samples. w: sum of their squared luminances.
@group(2) @binding(2) var<storage, read_write> film: array<vec4<f32>>;
@group(2) @binding(3) var<storage, read_write> film_tallies: array<vec4<u32>>;

// One thread per sample of the tile. The thread of a pixel's first sample adds up all samples of the pixel.
@compute @workgroup_size(WORKGROUP)
fn resolve(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= dispatch.count || sensor_sample(id.x).number != 0u) {
        return;
    }
    var sum = vec3<f32>(0.0);
    var squares = 0.0;
    var tally = vec4<u32>(0u);
    // The loop exits at its top: SwiftShader loses the last iteration of a loop that exits at its end (src/gpu/quirks.rs).
    let end = id.x + samples_of_pixel(id.x);
    for (var path = id.x; path < end; path++) {
        let r = radiance[path].xyz;
        let finite = is_finite(r);
        let counted = select(vec3<f32>(0.0), r, finite);
        sum += counted;
        squares += square(luminance(counted));
        tally += tallies[path] + vec4<u32>(select(1u, 0u, finite), 0u, 0u, 0u);
    }
    let p = sensor_sample(id.x).pixel - vec2<u32>(frame.crop_x, frame.crop_y);
    let index = p.y * frame.crop_width + p.x;
    film[index] = vec4<f32>(sum / f32(end - id.x), squares);
    film_tallies[index] = tally;
}
