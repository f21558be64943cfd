// Means over the samples of a pixel.
#import camera

@group(2) @binding(0) var<storage, read> radiance: array<vec4<f32>>;
@group(2) @binding(1) var<storage, read> tallies: array<vec4<u32>>;
// Row-major over the crop.
@group(2) @binding(2) var<storage, read_write> film: array<vec4<f32>>;
@group(2) @binding(3) var<storage, read_write> film_tallies: array<vec4<u32>>;

// One thread, one pixel of the tile.
@compute @workgroup_size(WORKGROUP)
fn resolve(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= dispatch.count / frame.samples) {
        return;
    }
    var sum = vec3<f32>(0.0);
    var tally = vec4<u32>(0u);
    for (var i = 0u; i < frame.samples; i++) {
        let path = id.x * frame.samples + i;
        let r = radiance[path].xyz;
        let finite = is_finite(r);
        sum += select(vec3<f32>(0.0), r, finite);
        tally += tallies[path] + vec4<u32>(select(1u, 0u, finite), 0u, 0u, 0u);
    }
    let p = crop_pixel(dispatch.first / frame.samples + id.x);
    let index = p.y * frame.crop_width + p.x;
    film[index] = vec4<f32>(sum / f32(frame.samples), 0.0);
    film_tallies[index] = tally;
}
