#import frame

// `Candidate.vertex` of a connection to the sky. The direction is sampled when the connection is made.
const SKY_VERTEX: u32 = 0xfffffffeu;

// A light vertex chosen for a shade point.
struct Candidate {
    // Index into `light_vertices`, or SKY_VERTEX.
    vertex: u32,
    // 1 / (K P(j | q)), the factor of Eqs. 25 and 26. For lcs: the resampling factor that replaces it.
    weight: f32,
}

// The slots of a shade point that hold a candidate are bits in words of `marks`, 32 in each word. Only these slots are written and read.
const SLOTS_PER_MARK: u32 = 32u;
// Whether a shade point may have more slots than that.
override HAS_MANY_SLOTS: bool = true;

// Number of words of `marks` per shade point.
fn mark_words() -> u32 {
    return select(1u, (frame.slots + SLOTS_PER_MARK - 1u) / SLOTS_PER_MARK, HAS_MANY_SLOTS);
}

// The fourth component of a contribution for which no shadow ray was traced. Travel times are always larger. They may be slightly
// negative where they omit the ways to a wall.
const NOT_TRACED: f32 = -3e38;
