// `Candidate.vertex` of a connection to the sky. The direction is sampled when the connection is made.
const SKY_VERTEX: u32 = 0xfffffffeu;

// A light vertex chosen for a shade point.
struct Candidate {
    // Index into `light_vertices`, SKY_VERTEX, or NONE for an empty slot.
    vertex: u32,
    // 1 / (K P(j | q)), the factor of Eqs. 25 and 26. For lcs: the resampling factor that replaces it.
    weight: f32,
}
