// The sensor samples of a tile, as list_samples.wgsl lists them.
#import camera

// One entry per sample, with two 16-bit numbers in each word, the first in the low half. x: column and row of the pixel in
// the whole film. y: number of the sample within its pixel and iteration, and the pixel's number of samples in this
// iteration. The samples of a pixel are consecutive and start with number 0. With SPLITS_AT_SHEETS, the last ones stop at thin glass
// (sheet.wgsl).
@group(2) @binding(8) var<storage, read> tile_samples: array<vec2<u32>>;

// Marks the keys of samples that stop at thin glass: they are counted apart, so that only the others take turns (event_strata.wgsl).
const STOPPING_BIT: u32 = 0x80000000u;

struct SensorSample {
    // Column and row of the pixel in the whole film.
    pixel: vec2<u32>,
    // Keys of the pixel's random numbers. `index`: row-major index of the pixel in the whole film, 0 if HAS_OWN_LASERS.
    index: u32,
    seed: u32,
    // Number of the sample within its pixel, counted in this iteration.
    number: u32,
    // The same number, counted over the whole render. Samples that stop at thin glass are counted apart, with STOPPING_BIT.
    sample: u32,
    // Whether the sample carries only the light of paths that begin at the thin glass which the camera sees.
    stops: bool,
}

// The pixel and the sample that sensor subpath `slot` of the tile belongs to.
fn sensor_sample(slot: u32) -> SensorSample {
    let s = tile_samples[slot];
    let number = s.y & 0xffffu;
    let pixel = vec2<u32>(s.x & 0xffffu, s.x >> 16u);
    let index = select(pixel.y * frame.width + pixel.x, 0u, HAS_OWN_LASERS);
    let passing = passing_samples(s.y >> 16u);
    let stops = number >= passing;
    let sample = select(frame.first_sample + number, STOPPING_BIT | (frame.first_sample + number - passing), stops);
    return SensorSample(pixel, index, pixel_seed(pixel), number, sample, stops);
}

// How many of the `count` samples of a pixel do not stop at thin glass. There is one that does for each four of them, or for a part of four
// (`sensor_samples` in render/plan.rs).
fn passing_samples(count: u32) -> u32 {
    return select(count, 4u * count / 5u, SPLITS_AT_SHEETS);
}

// Row-major index in the crop of a pixel with column and row in the whole film as in `tile_samples`.
fn crop_index(pixel: u32) -> u32 {
    let p = vec2<u32>(pixel & 0xffffu, pixel >> 16u) - vec2<u32>(frame.crop_x, frame.crop_y);
    return p.y * frame.crop_width + p.x;
}

// Number of samples that the pixel of sample `slot` has in this iteration.
fn samples_of_pixel(slot: u32) -> u32 {
    return tile_samples[slot].y >> 16u;
}
