// The samples of a tile, as the host lists them.
#import frame

// Column and row in the whole film, 16 bits each; number of the sample among those that the pixel has in this iteration. Samples of
// a pixel follow each other, from 0 on.
@group(2) @binding(8) var<storage, read> tile_samples: array<vec2<u32>>;

struct SensorSample {
    // Pixel of the whole film, and row-major.
    pixel: vec2<u32>,
    index: u32,
    // Number of the sample among those of the pixel: in this iteration, and over the whole render.
    number: u32,
    sample: u32,
}

// What sensor subpath `slot` of the tile samples.
fn sensor_sample(slot: u32) -> SensorSample {
    let s = tile_samples[slot];
    let pixel = vec2<u32>(s.x & 0xffffu, s.x >> 16u);
    return SensorSample(pixel, pixel.y * frame.width + pixel.x, s.y, frame.first_sample + s.y);
}
