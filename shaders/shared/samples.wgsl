// The samples of a tile, as the host lists them.
#import frame

// x: column and row in the whole film. y: number of the sample among those of its pixel in this iteration, and how many the pixel
// has. 16 bits each. Samples of a pixel follow each other, from 0 on.
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
    let number = s.y & 0xffffu;
    let pixel = vec2<u32>(s.x & 0xffffu, s.x >> 16u);
    return SensorSample(pixel, pixel.y * frame.width + pixel.x, number, frame.first_sample + number);
}

// How many samples the pixel of sample `slot` has in this iteration.
fn samples_of_pixel(slot: u32) -> u32 {
    return tile_samples[slot].y >> 16u;
}
