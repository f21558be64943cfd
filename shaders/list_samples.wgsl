// Lists the samples of a tile (samples.wgsl) from its pixels.
#import frame

// One entry per pixel of the tile. x: column (low 16 bits) and row of the pixel in the whole film. y: its first entry in
// `tile_samples`. A last entry holds the end of the samples.
@group(2) @binding(0) var<storage, read> tile_pixels: array<vec2<u32>>;
@group(2) @binding(1) var<storage, read_write> tile_samples: array<vec2<u32>>;

// One thread lists the samples of one pixel.
@compute @workgroup_size(WORKGROUP)
fn list_samples(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= dispatch.count) {
        return;
    }
    let pixel = tile_pixels[id.x];
    let count = tile_pixels[id.x + 1u].y - pixel.y;
    for (var number = 0u; number < count; number++) {
        tile_samples[pixel.y + number] = vec2<u32>(pixel.x, (count << 16u) | number);
    }
}
