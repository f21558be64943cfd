// A light vertex chosen for a shade point.
struct Candidate {
    // Index into `light_vertices`, NONE for an empty slot.
    vertex: u32,
    // 1 / (K P(j | q)), the factor of Eqs. 25 and 26; of lcs what resampling puts in its place.
    weight: f32,
}
