// Finds the surface that the centre of each pixel shows: for auxiliary layers of an image, and to name the object in a pixel.
#import camera
#import visibility

// Eight words per pixel: length of the camera ray, unit shading normal on the side of the sensor, albedo, and index into
// `instances`. The bit BLACK_BACK of the index marks the back of a surface that is neither double-sided nor glass. If the ray
// hits nothing, the last word is NONE, and the other words have no meaning.
@group(2) @binding(0) var<storage, read_write> surfaces: array<vec4<u32>>;

const BLACK_BACK = 0x80000000u;

// One thread traces the ray of one pixel. The first thread has pixel `dispatch.first`, a row-major index in the crop.
@compute @workgroup_size(WORKGROUP)
fn first_surface(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= dispatch.count) {
        return;
    }
    let index = dispatch.first + id.x;
    let column = frame.crop_x + index % frame.crop_width;
    let row = frame.crop_y + index / frame.crop_width;
    let ray = camera_ray(vec2<u32>(column, row), vec2<f32>(0.5));
    let direction = normalize(ray.direction);
    let hit = trace(ray.origin, direction, 3e38, false, NONE, vec4<u32>(0u));
    var near = vec4<u32>(0u);
    var seen = vec4<u32>(0u, 0u, 0u, NONE);
    if (hit.triangle != NONE) {
        let s = surface_at(hit.triangle, hit.u, hit.v);
        let front = dot(s.geometric, direction) <= 0.0;
        let shading = bumped_normal(s);
        let normal = select(-shading, shading, front);
        near = bitcast<vec4<u32>>(vec4<f32>(hit.t, normal));
        // The back of a surface that is not double-sided is black, unless it is the inside of glass.
        let m = load_material(s.material);
        let black = !front && (m.flags & MATERIAL_DOUBLE_SIDED) == 0u && m.transmission <= 0.0;
        let albedo = select(base_color(s).xyz, vec3<f32>(0.0), black);
        let instance = load_triangle(hit.triangle).instance | select(0u, BLACK_BACK, black);
        seen = vec4<u32>(bitcast<vec3<u32>>(albedo), instance);
    }
    surfaces[2u * id.x] = near;
    surfaces[2u * id.x + 1u] = seen;
}
