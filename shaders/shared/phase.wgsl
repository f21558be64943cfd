// Phase functions: the directions in which a medium scatters. A cosine is that between the directions in which light travels before
// and after scattering, 1 for light that goes straight on.
#import medium

// Two Henyey-Greenstein lobes; Rayleigh scattering; a Henyey-Greenstein lobe and a lobe of Draine; a table.
const PHASE_LOBES: u32 = 0u;
const PHASE_RAYLEIGH: u32 = 1u;
const PHASE_DRAINE: u32 = 2u;
const PHASE_TABLE: u32 = 3u;

// Which phase functions the media have, apart from single Henyey-Greenstein lobes: two such lobes, Rayleigh scattering, a lobe of
// Draine, a table. Kernels leave out the rest, because queries evaluate a phase function for each vertex of a leaf.
override HAS_TWO_LOBES: bool = false;
override HAS_RAYLEIGH: bool = false;
override HAS_DRAINE: bool = false;
override HAS_PHASE_TABLES: bool = false;

// One texel per node of a table: the cosine, the density per solid angle, and the share of the light that is scattered to smaller
// cosines. The density is linear between the nodes.
@group(0) @binding(14) var phase_tables: texture_1d<u32>;

// 1 + g^2 - 2 g c, for the mean cosine g of a Henyey-Greenstein lobe and the cosine c. In this form, no digits cancel in the peak,
// which is at c = -1 for g < 0.
fn lobe_distance2(g: f32, c: f32) -> f32 {
    let h = abs(g);
    let peak = square(1.0 - h);
    // Rounding may carry the cosine beyond 1. The lower bound keeps the result above 0 for the narrowest lobes.
    return max(peak + 2.0 * h * (1.0 - select(c, -c, g < 0.0)), 0.5 * peak);
}

// Density per solid angle of the Henyey-Greenstein lobe with the mean cosine g.
fn henyey_greenstein(g: f32, cosine: f32) -> f32 {
    let x = lobe_distance2(g, cosine);
    return (1.0 - g * g) / (4.0 * PI * x * sqrt(x));
}

// Phase function: density per solid angle of scattering by the angle with this cosine. Its integral over the sphere is 1.
fn phase_value(m: Medium, cosine: f32) -> f32 {
    if (HAS_RAYLEIGH && m.phase == PHASE_RAYLEIGH) {
        return 3.0 / (16.0 * PI) * (1.0 + cosine * cosine);
    }
    if (HAS_DRAINE && m.phase == PHASE_DRAINE) {
        return mix(henyey_greenstein(m.g, cosine), draine(m.g2, m.alpha, cosine), m.share);
    }
    if (HAS_PHASE_TABLES && m.phase == PHASE_TABLE) {
        return table_value(m, cosine);
    }
    if (!HAS_TWO_LOBES) {
        return henyey_greenstein(m.g, cosine);
    }
    return mix(henyey_greenstein(m.g, cosine), henyey_greenstein(m.g2, cosine), m.share);
}

// Samples the cosine of the scattering angle, with the density of `phase_value`. `u`: one number for the angle, one for the lobe.
fn sample_phase_cosine(m: Medium, u: vec2<f32>) -> f32 {
    if (HAS_RAYLEIGH && m.phase == PHASE_RAYLEIGH) {
        // The root of the cubic equation of the cumulative distribution.
        let q = 4.0 * u.x - 2.0;
        let root = pow(abs(q) + sqrt(q * q + 1.0), 1.0 / 3.0);
        return clamp(sign(q) * (root - 1.0 / root), -1.0, 1.0);
    }
    if (HAS_PHASE_TABLES && m.phase == PHASE_TABLE) {
        return sample_table(m, u.x);
    }
    if (HAS_DRAINE && m.phase == PHASE_DRAINE && u.y < m.share) {
        return sample_draine(m.g2, m.alpha, u.x);
    }
    return sample_henyey_greenstein(select(m.g, m.g2, u.y < m.share), u.x);
}

// Inverse of the cumulative distribution of the Henyey-Greenstein lobe: it scatters the share u of the light to cosines below the result.
fn sample_henyey_greenstein(g: f32, u: f32) -> f32 {
    if (abs(g) < 1e-3) {
        // Nearly isotropic: the first terms of the series in g.
        let c = 2.0 * u - 1.0;
        return clamp(c + 1.5 * g * (1.0 - c * c), -1.0, 1.0);
    }
    let x = (1.0 - g * g) / (1.0 - g + 2.0 * g * u);
    return clamp((1.0 + g * g - x * x) / (2.0 * g), -1.0, 1.0);
}

// Integral of 1 + alpha c^2 over the sphere, with the Henyey-Greenstein lobe as density.
fn draine_norm(g: f32, alpha: f32) -> f32 {
    return 1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0;
}

// Density per solid angle of the lobe of Draine 2003: the Henyey-Greenstein lobe times 1 + alpha c^2, normalised.
fn draine(g: f32, alpha: f32, cosine: f32) -> f32 {
    return henyey_greenstein(g, cosine) * (1.0 + alpha * cosine * cosine) / draine_norm(g, alpha);
}

// Share of the light that the lobe of Draine scatters to cosines below c.
//
// With y^2 = 1 + g^2 - 2 g c, the integral of the Henyey-Greenstein lobe times c^2 is a polynomial in y and 1 / y, over g^3. Here
// it is rearranged so that all powers of g in the denominator cancel: the result is accurate for every g, also for 0.
fn draine_share(g: f32, alpha: f32, c: f32) -> f32 {
    let a = 1.0 + g * g;
    let y = sqrt(lobe_distance2(g, c));
    let sum = 1.0 + g + y;
    let lobe = (1.0 - g) * (1.0 + c) / (y * sum);
    let p = (1.0 + g) * y;
    let r = (a * (1.0 - c) - 2.0 * g * c) / (a + p);
    let squares = (1.0 - g * g) * (1.0 + c) / (3.0 * sum * p * (a + p)) * ((1.0 - c) * r * (p + 3.0 * a) + c * (3.0 * a - p));
    return (lobe + alpha * squares) / draine_norm(g, alpha);
}

// Iterations of `sample_draine`. Eight are enough for float precision with alpha up to 100.
const DRAINE_ITERATIONS: u32 = 12u;

// Inverse of the cumulative distribution of the lobe of Draine. The unknown is the share v that the Henyey-Greenstein lobe scatters to
// cosines below the result. Newton's method finds v, kept inside an interval that contains it.
fn sample_draine(g: f32, alpha: f32, u: f32) -> f32 {
    var lo = 0.0;
    var hi = 1.0;
    var v = u;
    for (var i = 0u; i < DRAINE_ITERATIONS; i++) {
        let c = sample_henyey_greenstein(g, v);
        let excess = draine_share(g, alpha, c) - u;
        lo = select(v, lo, excess > 0.0);
        hi = select(hi, v, excess > 0.0);
        let next = v - excess * draine_norm(g, alpha) / (1.0 + alpha * c * c);
        v = select(0.5 * (lo + hi), next, next >= lo && next <= hi);
    }
    return sample_henyey_greenstein(g, v);
}

// Component of the nodes of a table by which `table_interval` searches.
const BY_NODE_COSINE: u32 = 0u;
const BY_NODE_SHARE: u32 = 2u;

fn load_node(m: Medium, index: u32) -> vec3<f32> {
    return bitcast<vec3<f32>>(textureLoad(phase_tables, m.table + index, 0).xyz);
}

// Number of the node of m's table where the interval with x begins: the component is at most x at this node, and above x at the next.
// If x lies outside the table, the first or the last interval counts.
fn table_interval(m: Medium, component: u32, x: f32) -> u32 {
    var below = 0u;
    var above = m.table_size - 1u;
    while (above - below > 1u) {
        let middle = (below + above) / 2u;
        let node = load_node(m, middle);
        let is_below = select(node.x, node.z, component == BY_NODE_SHARE) <= x;
        below = select(below, middle, is_below);
        above = select(middle, above, is_below);
    }
    return below;
}

fn table_value(m: Medium, cosine: f32) -> f32 {
    let first = table_interval(m, BY_NODE_COSINE, cosine);
    let a = load_node(m, first);
    let b = load_node(m, first + 1u);
    return mix(a.y, b.y, clamp((cosine - a.x) / (b.x - a.x), 0.0, 1.0));
}

// Inverse of the cumulative distribution of m's table.
fn sample_table(m: Medium, u: f32) -> f32 {
    let first = table_interval(m, BY_NODE_SHARE, u);
    let a = load_node(m, first);
    let b = load_node(m, first + 1u);
    let width = b.x - a.x;
    // The share is quadratic between two nodes. In this form of its root, no digits cancel.
    let rest = (u - a.z) / (2.0 * PI);
    let slope = (b.y - a.y) / width;
    let root = sqrt(max(a.y * a.y + 2.0 * slope * rest, 0.0));
    let x = 2.0 * rest / max(a.y + root, 1e-37);
    return clamp(a.x + min(x, width), -1.0, 1.0);
}
