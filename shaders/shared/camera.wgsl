// The pinhole camera: the direction of a film point, and the pixel that sees a direction.
#import frame
#import math

// Direction from the pinhole through the film point `p`, in pixels of the whole film with row 0 at the top. Not normalised:
// its component along the camera axis is 1.
fn film_direction(p: vec2<f32>) -> vec3<f32> {
    let q = p - frame.principal_offset;
    let x = (2.0 * q.x / f32(frame.width) - 1.0) * frame.extent.x;
    let y = (1.0 - 2.0 * q.y / f32(frame.height)) * frame.extent.y;
    return frame.forward + x * frame.right + y * frame.up;
}

// Density per solid angle of directions that are sampled uniformly over the area of one pixel. `cosine` is the cosine of the
// angle to the camera axis.
fn pixel_pdf(cosine: f32) -> f32 {
    return 1.0 / (frame.pixel_area * cosine * cosine * cosine);
}

// Index, row-major over the crop, of the pixel that sees the direction `d` (of any length). NONE if `d` points behind the
// sensor or outside the crop.
fn pixel_of(d: vec3<f32>) -> u32 {
    let z = dot(d, frame.forward);
    if (z <= 0.0) {
        return NONE;
    }
    let x = (dot(d, frame.right) / (z * frame.extent.x) + 1.0) * 0.5 * f32(frame.width) + frame.principal_offset.x;
    let y = (1.0 - dot(d, frame.up) / (z * frame.extent.y)) * 0.5 * f32(frame.height) + frame.principal_offset.y;
    let lo = vec2<f32>(f32(frame.crop_x), f32(frame.crop_y));
    let hi = lo + vec2<f32>(f32(frame.crop_width), f32(frame.crop_height));
    if (!(x >= lo.x && y >= lo.y && x < hi.x && y < hi.y)) {
        return NONE;
    }
    return (u32(y) - frame.crop_y) * frame.crop_width + u32(x) - frame.crop_x;
}
