// Which transmitting solid a path is in. Codes: OUTSIDE_SOLIDS, CLEAR_SOLID, or FIRST_INTERIOR plus the index into `media` of the
// medium inside. The host knows the solids around emitters and the camera. A path then learns its solid from the side of each
// transmitting surface that it hits. Between such surfaces, and at opaque objects inside of a solid, it carries the code in its
// flags. Without HAS_INTERIORS no medium depends on the solid. Paths then carry no code, and `path_solid` is always
// OUTSIDE_SOLIDS.
#import material
#import path

const OUTSIDE_SOLIDS: u32 = 0u;
const CLEAR_SOLID: u32 = 1u;
const FIRST_INTERIOR: u32 = 2u;

// Code of the inside of solids of this material.
fn solid_of(material: u32) -> u32 {
    if (!HAS_INTERIORS) {
        return CLEAR_SOLID;
    }
    let interior = load_material(material).interior;
    return select(FIRST_INTERIOR + interior, CLEAR_SOLID, interior == NONE);
}

// Code of the solid around an emitter or the camera; without HAS_INTERIORS always OUTSIDE_SOLIDS. `material`: that of the solid; NONE
// outside of solids.
fn solid_around(material: u32) -> u32 {
    if (!HAS_TRANSMISSION || !HAS_INTERIORS || material == NONE) {
        return OUTSIDE_SOLIDS;
    }
    return solid_of(material);
}

// Travel time per length around an emitter or the camera. `material`: see `solid_around`.
fn eta_around(material: u32) -> f32 {
    if (!HAS_TRANSMISSION || material == NONE) {
        return SURROUNDING_GROUP_INDEX;
    }
    return solid_index(material);
}

// Code of the solid that a subpath travels in.
fn path_solid(s: PathState) -> u32 {
    return select(OUTSIDE_SOLIDS, s.flags >> PATH_SOLID_SHIFT, HAS_INTERIORS);
}

// The flags of a subpath that travels in `solid`.
fn with_solid(flags: u32, solid: u32) -> u32 {
    if (!HAS_INTERIORS) {
        return flags;
    }
    return (flags & ((1u << PATH_SOLID_SHIFT) - 1u)) | (solid << PATH_SOLID_SHIFT);
}
