// Where a lens moves the points of the image: the models of OpenCV, as `src/scene/lens.rs` defines them. `image`: in focal lengths from
// the principal point, x to the right and y down. `to`: a direction with x to the right, y down and z along the view.
#import frame
#import math

// Number of Newton steps that invert a lens. The host has checked that they suffice everywhere in the image.
const LENS_STEPS = 10u;

// A point of the image, and the derivative of its place by the place of the pinhole's image, a symmetric matrix.
struct Distorted {
    point: vec2<f32>,
    xx: f32,
    yy: f32,
    xy: f32,
}

// The rational model with tangential distortion (HAS_DISTORTION) at the pinhole's image `p`.
fn distort(p: vec2<f32>) -> Distorted {
    let k = frame.lens_radial;
    let rest = frame.lens_rest;
    let r2 = dot(p, p);
    let above = 1.0 + r2 * (k.x + r2 * (k.y + r2 * k.z));
    let below = 1.0 + r2 * (k.w + r2 * (rest.x + r2 * rest.y));
    let factor = above / below;
    // The derivative of the factor by r^2.
    let slope = (k.x + r2 * (2.0 * k.y + r2 * 3.0 * k.z) - factor * (k.w + r2 * (2.0 * rest.x + r2 * 3.0 * rest.y))) / below;
    let p1 = rest.z;
    let p2 = rest.w;
    let shift = vec2<f32>(2.0 * p1 * p.x * p.y + p2 * (r2 + 2.0 * p.x * p.x), p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * p2 * p.x * p.y);
    return Distorted(
        factor * p + shift,
        factor + 2.0 * p.x * p.x * slope + 2.0 * p1 * p.y + 6.0 * p2 * p.x,
        factor + 2.0 * p.y * p.y * slope + 6.0 * p1 * p.y + 2.0 * p2 * p.x,
        2.0 * p.x * p.y * slope + 2.0 * (p1 * p.x + p2 * p.y),
    );
}

fn determinant_of(d: Distorted) -> f32 {
    return d.xx * d.yy - d.xy * d.xy;
}

// Distance of a fisheye's image from the principal point at the angle `a` to the view, and its derivative.
fn fisheye_distance(a: f32) -> vec2<f32> {
    let k = frame.lens_radial;
    let a2 = a * a;
    let factor = 1.0 + a2 * (k.x + a2 * (k.y + a2 * (k.z + a2 * k.w)));
    let slope = 1.0 + a2 * (3.0 * k.x + a2 * (5.0 * k.y + a2 * (7.0 * k.z + a2 * 9.0 * k.w)));
    return vec2<f32>(a * factor, slope);
}

// The direction with this image. For the rational model its z is 1, for a fisheye its length.
fn lens_direction(image: vec2<f32>) -> vec3<f32> {
    if (HAS_FISHEYE) {
        let distance = length(image);
        var angle = distance;
        for (var i = 0u; i < LENS_STEPS; i++) {
            let found = fisheye_distance(angle);
            angle -= (found.x - distance) / found.y;
        }
        let turn = cosine_and_sine(angle);
        return vec3<f32>(image * (turn.y / max(distance, 1e-30)), turn.x);
    }
    var p = image;
    for (var i = 0u; i < LENS_STEPS; i++) {
        let found = distort(p);
        let error = found.point - image;
        let step = vec2<f32>(found.yy * error.x - found.xy * error.y, found.xx * error.y - found.xy * error.x);
        p -= step / determinant_of(found);
    }
    return vec3<f32>(p, 1.0);
}

// The image of a direction. Its z is 0 if the lens does not see the direction, else 1.
fn lens_image(to: vec3<f32>) -> vec3<f32> {
    let aside = length(to.xy);
    if (HAS_FISHEYE) {
        let angle = atan2(aside, to.z);
        let scale = fisheye_distance(angle).x / max(aside, 1e-30);
        return vec3<f32>(scale * to.xy, select(0.0, 1.0, angle <= frame.lens_limit));
    }
    if (to.z <= 0.0 || aside > frame.lens_limit * to.z) {
        return vec3<f32>(0.0);
    }
    return vec3<f32>(distort(to.xy / to.z).point, 1.0);
}

// Area of the image per solid angle of the rays that form it. `to`: the direction through the centre of the lens. `cosine`: the cosine of
// the angle between the ray and the view; it differs from that of `to` if the ray passes the lens off its centre.
fn lens_spread(to: vec3<f32>, cosine: f32) -> f32 {
    if (HAS_FISHEYE) {
        let unit = normalize(to);
        let aside = length(unit.xy);
        let found = fisheye_distance(atan2(aside, unit.z));
        // On the axis, the distance over the sine is 1.
        return found.y * select(1.0, found.x / aside, aside > 1e-6);
    }
    return determinant_of(distort(to.xy / to.z)) / (cosine * cosine * cosine);
}

// A point of the aperture relative to its centre, x to the right and y down, uniform over its area: a disc, or the regular polygon of the
// blades, whose corners lie on the rim of the disc.
fn aperture_point(u: vec2<f32>) -> vec2<f32> {
    let r = frame.lens_radius * sqrt(u.x);
    if (frame.blades == 0u) {
        return r * cosine_and_sine(2.0 * PI * u.y);
    }
    let blades = f32(frame.blades);
    let blade = min(floor(u.y * blades), blades - 1.0);
    let first = cosine_and_sine(2.0 * PI * blade / blades);
    let second = cosine_and_sine(2.0 * PI * (blade + 1.0) / blades);
    return r * mix(first, second, u.y * blades - blade);
}

// The direction from the point `at` of the aperture to the point in focus in the direction `chief`, whose z is 1. Its z is 1 too.
fn focused_ray(chief: vec3<f32>, at: vec2<f32>) -> vec3<f32> {
    return chief - vec3<f32>(at * frame.inverse_focus, 0.0);
}

// The direction from the centre of the lens to the point in focus that the ray from the point `at` of the aperture along `to` passes. Its
// z is 1. 0 if the ray goes backwards.
fn chief_ray(to: vec3<f32>, at: vec2<f32>) -> vec3<f32> {
    if (to.z <= 0.0) {
        return vec3<f32>(0.0);
    }
    return vec3<f32>(at * frame.inverse_focus + to.xy / to.z, 1.0);
}

// A lens delays all rays of a point in focus alike (Fermat), so the travel time of a ray is counted as if it passed the centre of the lens:
// the length by which the way to the point in focus is longer from there than from the point `at`.
fn lens_path(chief: vec3<f32>, at: vec2<f32>) -> f32 {
    let difference = 2.0 * dot(chief.xy, at) - dot(at, at) * frame.inverse_focus;
    return difference / (length(chief) + length(focused_ray(chief, at)));
}
