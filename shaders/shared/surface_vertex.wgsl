// The vertex of a path at a point of a surface.
#import vertex
#import surface

// The vertex at `surface`, without the fields that depend on the rest of the path. `towards`: unit direction to the previous vertex.
fn surface_vertex(surface: Surface, towards: vec3<f32>) -> PathVertex {
    let side = dot(surface.geometric, towards);
    let flip = select(1.0, -1.0, side < 0.0);
    let m = load_material(surface.material);
    let normal = bumped_normal(surface);
    var v: PathVertex;
    v.position = surface.position;
    v.material = surface.material;
    v.normal = normal * flip;
    v.geometric = surface.geometric * flip;
    v.to_previous = towards;
    v.flags = select(0u, VERTEX_FRONT, side >= 0.0) | select(0u, VERTEX_TRANSMITS, bounds_solid(m)) | select(0u, VERTEX_SHEET, is_thin(m))
        | select(0u, VERTEX_BUMPED, HAS_NORMAL_MAPS && any(normal != surface.normal));
    v.point_words = point_words(surface);
    v.offset = surface.offset;
    v.select_pdf = 1.0;
    return v;
}
