// The camera: rays of film points, the pixel that sees a point, and the segment from a point to the sensor.
//
// All camera rays of a pinhole start at one point. The rays of an orthographic camera are parallel. They start on the sensor
// plane, which passes through the camera perpendicular to its axis, and travel times end there. Each pixel of a scanning sensor
// (HAS_AIMS) has its own direction in `aims`, and a square field of view around this direction, which may be a single ray. All
// its rays start at one point. Light vertices are not connected to a scanning sensor.
#import frame
#import lens
#import math

// One texel per pixel of the whole film: its unit direction, and the length by which its travel times are shortened. If
// HAS_OWN_LASERS, the seed of its random numbers takes the place of the length, which is 0.
@group(0) @binding(17) var aims: texture_1d<u32>;

struct CameraRay {
    origin: vec3<f32>,
    // Not normalised: its component along the camera axis (with HAS_AIMS: along the direction of the pixel) is 1. With HAS_FISHEYE, its
    // length is 1.
    direction: vec3<f32>,
}

// The straight segment from a point to the sensor.
struct SensorSegment {
    // Its end on the sensor.
    end: vec3<f32>,
    // Unit direction towards the sensor.
    direction: vec3<f32>,
    // Negative for a point behind the sensor plane of an orthographic camera.
    length: f32,
}

// Camera ray through the point `u` of a pixel, (0, 0) to (1, 1) from its upper left corner. Only rays in the cone of the pixel's laser if
// `has_narrow_laser`; then `u` is uniform over the cone, with the weight `lit_share`. `pixel`: column and row in the whole film,
// with row 0 at the top.
fn camera_ray(pixel: vec2<u32>, u: vec2<f32>) -> CameraRay {
    if (HAS_AIMS) {
        // `pixel` and `u` are not added as below: the sum can round up to the next pixel, which has another direction.
        let axis = load_aim(pixel).xyz;
        var offset = (2.0 * u - 1.0) * frame.extent;
        if (has_narrow_laser()) {
            let turn = cosine_and_sine(2.0 * PI * u.y);
            offset = LASER_RADIUS * sqrt(u.x) * turn;
        }
        return CameraRay(frame.sensor, frame_around(axis) * vec3<f32>(offset, 1.0));
    }
    let q = vec2<f32>(pixel) + u - frame.principal_offset;
    let x = (2.0 * q.x / f32(frame.width) - 1.0) * frame.extent.x;
    let y = (1.0 - 2.0 * q.y / f32(frame.height)) * frame.extent.y;
    if (HAS_ORTHOGRAPHIC) {
        return CameraRay(frame.sensor + x * frame.right + y * frame.up, frame.forward);
    }
    if (has_lens()) {
        let to = lens_direction(vec2<f32>(x, -y));
        return CameraRay(frame.sensor, from_lens(to));
    }
    return CameraRay(frame.sensor, frame.forward + x * frame.right + y * frame.up);
}

fn has_lens() -> bool {
    return HAS_DISTORTION || HAS_FISHEYE;
}

// A vector in the axes of `lens.wgsl`.
fn to_lens(d: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot(d, frame.right), -dot(d, frame.up), dot(d, frame.forward));
}

// Whether the cone of the laser of a pixel lies within the pixel (HAS_OWN_LASERS). The rest of the pixel is dark.
fn has_narrow_laser() -> bool {
    return HAS_OWN_LASERS && LASER_RADIUS > 0.0 && LASER_RADIUS <= (1.0 + 1e-5) * frame.extent.x;
}

// The part of the pixel's area that lies in the cone of its laser. Needs `has_narrow_laser`.
fn lit_share() -> f32 {
    return PI * square(LASER_RADIUS) / (4.0 * frame.extent.x * frame.extent.y);
}

// The entry of `aims` for a pixel of the whole film.
fn load_aim(pixel: vec2<u32>) -> vec4<f32> {
    return bitcast<vec4<f32>>(textureLoad(aims, pixel.y * frame.width + pixel.x, 0));
}

// Seed of the random numbers of a pixel of the whole film.
fn pixel_seed(pixel: vec2<u32>) -> u32 {
    if (HAS_OWN_LASERS) {
        return textureLoad(aims, pixel.y * frame.width + pixel.x, 0).w;
    }
    return frame.seed;
}

// Density of camera rays that are sampled uniformly over the area of one pixel: per solid angle for a pinhole, per area
// perpendicular to the rays for an orthographic camera. `cosine` is the cosine of the angle of the ray to the camera axis. `chief` is the
// direction through the centre of the lens, which counts only if the lens distorts.
fn pixel_pdf(cosine: f32, chief: vec3<f32>) -> f32 {
    if (HAS_ORTHOGRAPHIC) {
        return 1.0 / frame.pixel_area;
    }
    if (has_lens()) {
        return lens_spread(to_lens(chief), cosine) / frame.pixel_area;
    }
    return 1.0 / (frame.pixel_area * cosine * cosine * cosine);
}

// The inverse of `to_lens`.
fn from_lens(to: vec3<f32>) -> vec3<f32> {
    return to.x * frame.right - to.y * frame.up + to.z * frame.forward;
}

// Index, row-major over the crop, of the pixel that sees the point at the offset `d` from `frame.sensor`. NONE if the point is
// not in front of the sensor or is outside the crop.
fn pixel_of(d: vec3<f32>) -> u32 {
    var x: f32;
    var y: f32;
    if (has_lens()) {
        let seen = lens_image(to_lens(d));
        if (seen.z == 0.0) {
            return NONE;
        }
        x = (seen.x / frame.extent.x + 1.0) * 0.5 * f32(frame.width) + frame.principal_offset.x;
        y = (seen.y / frame.extent.y + 1.0) * 0.5 * f32(frame.height) + frame.principal_offset.y;
    } else {
        let z = dot(d, frame.forward);
        if (z <= 0.0) {
            return NONE;
        }
        let scale = select(z, 1.0, HAS_ORTHOGRAPHIC);
        x = (dot(d, frame.right) / (scale * frame.extent.x) + 1.0) * 0.5 * f32(frame.width) + frame.principal_offset.x;
        y = (1.0 - dot(d, frame.up) / (scale * frame.extent.y)) * 0.5 * f32(frame.height) + frame.principal_offset.y;
    }
    let lo = vec2<f32>(f32(frame.crop_x), f32(frame.crop_y));
    let hi = lo + vec2<f32>(f32(frame.crop_width), f32(frame.crop_height));
    if (!(x >= lo.x && y >= lo.y && x < hi.x && y < hi.y)) {
        return NONE;
    }
    return (u32(y) - frame.crop_y) * frame.crop_width + u32(x) - frame.crop_x;
}

// The segment along which the sensor sees the point `p`, through the point `at` of the aperture if there is one.
fn segment_to_sensor(p: vec3<f32>, at: vec2<f32>) -> SensorSegment {
    let from_sensor = p - frame.sensor;
    if (HAS_ORTHOGRAPHIC) {
        let z = dot(from_sensor, frame.forward);
        return SensorSegment(p - z * frame.forward, -frame.forward, z);
    }
    if (HAS_APERTURE) {
        let aside = from_lens(vec3<f32>(at, 0.0));
        let d = length(from_sensor - aside);
        return SensorSegment(frame.sensor + aside, (aside - from_sensor) / d, d);
    }
    let d = length(from_sensor);
    return SensorSegment(frame.sensor, -from_sensor / d, d);
}

// The point of the sensor that is nearest to `p`; of an aperture, its centre. The whole film counts, not only the crop.
fn nearest_sensor_point(p: vec3<f32>) -> vec3<f32> {
    if (!HAS_ORTHOGRAPHIC) {
        return frame.sensor;
    }
    let from_sensor = p - frame.sensor;
    let size = vec2<f32>(f32(frame.width), f32(frame.height));
    // Centre of the film, right and up of the camera.
    let centre = vec2<f32>(-2.0, 2.0) * frame.principal_offset / size * frame.extent;
    let at = vec2<f32>(dot(from_sensor, frame.right), dot(from_sensor, frame.up));
    let nearest = clamp(at, centre - frame.extent, centre + frame.extent);
    return frame.sensor + nearest.x * frame.right + nearest.y * frame.up;
}
