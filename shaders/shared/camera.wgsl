// The pinhole at the origin.
#import frame
#import math

// Direction through the point `p` of the film, in pixels, row 0 at the top. Not normalised: depth 1 along the axis.
fn film_direction(p: vec2<f32>) -> vec3<f32> {
    let x = (2.0 * p.x / f32(frame.width) - 1.0) * frame.extent.x;
    let y = (1.0 - 2.0 * p.y / f32(frame.height)) * frame.extent.y;
    return frame.forward + x * frame.right + y * frame.up;
}

// Density per solid angle of directions drawn uniformly over one pixel; `cosine` to the axis.
fn pixel_pdf(cosine: f32) -> f32 {
    return 1.0 / (frame.pixel_area * cosine * cosine * cosine);
}

// Pixel that sees the direction `d`, or NONE: behind the sensor, off the film or off the crop.
fn pixel_of(d: vec3<f32>) -> u32 {
    let z = dot(d, frame.forward);
    if (z <= 0.0) {
        return NONE;
    }
    let x = (dot(d, frame.right) / (z * frame.extent.x) + 1.0) * 0.5 * f32(frame.width);
    let y = (1.0 - dot(d, frame.up) / (z * frame.extent.y)) * 0.5 * f32(frame.height);
    let lo = vec2<f32>(f32(frame.crop_x), f32(frame.crop_y));
    let hi = lo + vec2<f32>(f32(frame.crop_width), f32(frame.crop_height));
    if (!(x >= lo.x && y >= lo.y && x < hi.x && y < hi.y)) {
        return NONE;
    }
    return (u32(y) - frame.crop_y) * frame.crop_width + u32(x) - frame.crop_x;
}

struct SensorSample {
    // Pixel of the whole film.
    pixel: vec2<u32>,
    // Number of the sample of that pixel over the whole render.
    sample: u32,
}

const BLOCK: u32 = 8u;

// Sample number `index` of the iteration: samples of a pixel are neighbours, pixels run in blocks of 8 x 8.
fn sensor_sample(index: u32) -> SensorSample {
    let p = crop_pixel(index / frame.samples);
    return SensorSample(p + vec2<u32>(frame.crop_x, frame.crop_y), frame.first_sample + index % frame.samples);
}

// Pixel within the crop at position `i` of the block order: rows of blocks, blocks from left to right, rows in a block.
fn crop_pixel(i: u32) -> vec2<u32> {
    let strip = BLOCK * frame.crop_width;
    let block_y = i / strip;
    let rows = min(BLOCK, frame.crop_height - block_y * BLOCK);
    let in_strip = i % strip;
    let block_x = in_strip / (BLOCK * rows);
    let columns = min(BLOCK, frame.crop_width - block_x * BLOCK);
    let in_block = in_strip % (BLOCK * rows);
    return vec2<u32>(block_x * BLOCK + in_block % columns, block_y * BLOCK + in_block / columns);
}
