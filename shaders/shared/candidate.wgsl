// `Candidate.vertex` of a connection to the sky. The direction is sampled when the connection is made.
const SKY_VERTEX: u32 = 0xfffffffeu;

// A light vertex chosen for a shade point.
struct Candidate {
    // Index into `light_vertices`, SKY_VERTEX, or NONE for an empty slot.
    vertex: u32,
    // 1 / (K P(j | q)), the factor of Eqs. 25 and 26. For lcs: the resampling factor that replaces it.
    weight: f32,
}

// The fourth component of a contribution for which no shadow ray was traced. Travel times are always larger. They may be slightly
// negative where they omit the ways to a wall.
const NOT_TRACED: f32 = -3e38;
