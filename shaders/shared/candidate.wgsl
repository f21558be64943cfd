// A light vertex chosen for a shade point.
struct Candidate {
    // Index into `light_vertices`, NONE for an empty slot.
    vertex: u32,
    // 1 / (K P(j | q)), the factor of Eqs. 25 and 26. For lcs: the resampling factor that replaces it.
    weight: f32,
}
