// Density grids: the density of a medium at a point, and its integral along a ray.
//
// A grid consists of cells. The density is trilinear in a cell, so it is a cubic polynomial along a ray, and two-point Gauss quadrature
// gives its integral exactly. Optical depths are therefore exact: no random numbers are needed, and media with a grid are sampled
// like homogeneous media.
#import frame
#import math

struct Grid {
    // Rows of the affine map from render space to the space in which each cell is a unit cube and the grid starts at 0.
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
    // Number of cells per axis; 0 if the medium has no grid.
    cells: vec3<u32>,
    // Texel of the first cell in `densities`, and of the first block.
    first: u32,
    first_block: u32,
    // Largest density.
    scale: f32,
    // Mean density.
    mean: f32,
    // Whether cells lie between the centres of voxels (1), or are the voxels (0).
    is_linear: u32,
}

// Cells per axis of a block.
const BLOCK: u32 = 8u;

// Five texels per medium.
@group(0) @binding(15) var grids: texture_1d<u32>;
// Per cell: the densities at its corners in units of `scale`, 16 bits each, x fastest. Per block: the bits of its density if it is
// constant, else the bits of a negative number.
@group(0) @binding(16) var densities: texture_1d<u32>;

fn load_grid(index: u32) -> Grid {
    let x = bitcast<vec4<f32>>(textureLoad(grids, 5u * index, 0));
    let y = bitcast<vec4<f32>>(textureLoad(grids, 5u * index + 1u, 0));
    let z = bitcast<vec4<f32>>(textureLoad(grids, 5u * index + 2u, 0));
    let cells = textureLoad(grids, 5u * index + 3u, 0);
    let rest = textureLoad(grids, 5u * index + 4u, 0);
    return Grid(x, y, z, cells.xyz, cells.w, rest.x, bitcast<f32>(rest.y), bitcast<f32>(rest.z), rest.w);
}

// Whether the medium has a grid.
fn has_grid(g: Grid) -> bool {
    return g.cells.x > 0u;
}

// The point p in the space of cells.
fn point_in_grid(g: Grid, p: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot(g.x.xyz, p) + g.x.w, dot(g.y.xyz, p) + g.y.w, dot(g.z.xyz, p) + g.z.w);
}

// The direction d in the space of cells, not normalised. No component is 0, so that the caller may divide by it.
fn direction_in_grid(g: Grid, d: vec3<f32>) -> vec3<f32> {
    let direction = vec3<f32>(dot(g.x.xyz, d), dot(g.y.xyz, d), dot(g.z.xyz, d));
    return select(direction, vec3<f32>(1e-30), abs(direction) < vec3<f32>(1e-30));
}

// Distances along o + t d between which the ray is in the grid; x > y if it misses the grid.
fn grid_span(g: Grid, o: vec3<f32>, d: vec3<f32>) -> vec2<f32> {
    let inverse = 1.0 / direction_in_grid(g, d);
    let origin = point_in_grid(g, o);
    let a = (grid_margin(g) - origin) * inverse;
    let b = (vec3<f32>(g.cells) - grid_margin(g) - origin) * inverse;
    return vec2<f32>(max_component(min(a, b)), -max_component(-max(a, b)));
}

// A cell of a linear grid lies between the centres of voxels, so the outermost cells reach half a voxel over the edge of the grid.
fn grid_margin(g: Grid) -> vec3<f32> {
    return vec3<f32>(select(0.0, 0.5, g.is_linear != 0u));
}

// Densities at the corners of a cell, in units of the largest density; first the four with the lower z.
struct Cell {
    low: vec4<f32>,
    high: vec4<f32>,
}

fn cell_corners(g: Grid, cell: vec3<u32>) -> Cell {
    let words = textureLoad(densities, g.first + cell.x + g.cells.x * (cell.y + g.cells.y * cell.z), 0);
    return Cell(vec4<f32>(unpack2x16unorm(words.x), unpack2x16unorm(words.y)),
        vec4<f32>(unpack2x16unorm(words.z), unpack2x16unorm(words.w)));
}

// Density of the cell at `p`, whose coordinates in the cell are from 0 to 1.
fn cell_density(c: Cell, p: vec3<f32>) -> f32 {
    let f = clamp(p, vec3<f32>(0.0), vec3<f32>(1.0));
    let corners = mix(c.low, c.high, f.z);
    let edge = mix(corners.xy, corners.zw, f.y);
    return mix(edge.x, edge.y, f.x);
}

// Integral of the density of the cell over 0 < t < 1 on the line p + t d, by Gauss quadrature at the two points
// (1 -+ 1 / sqrt(3)) / 2. It is exact for a cubic polynomial.
fn cell_integral(c: Cell, p: vec3<f32>, d: vec3<f32>) -> f32 {
    return 0.5 * (cell_density(c, p + 0.21132487 * d) + cell_density(c, p + 0.78867513 * d));
}

// The cell at a point of the space of cells; the nearest one if the point is outside.
fn cell_at(g: Grid, p: vec3<f32>) -> vec3<i32> {
    return clamp(vec3<i32>(floor(p)), vec3<i32>(0), vec3<i32>(g.cells) - 1);
}

// Density of the grid at p.
fn grid_density(g: Grid, p: vec3<f32>) -> f32 {
    let at = point_in_grid(g, p);
    let cell = cell_at(g, at);
    return g.scale * cell_density(cell_corners(g, vec3<u32>(cell)), at - vec3<f32>(cell));
}

// A part of a ray through a medium: its length, and the integral of the density over it.
struct Passage {
    length: f32,
    integral: f32,
}

// Follows the ray o + t d through the grid from t = `first`. Ends at t = `last`, or where the integral of the density is `needed`.
fn pass_grid(g: Grid, o: vec3<f32>, d: vec3<f32>, first: f32, last: f32, needed: f32) -> Passage {
    let origin = point_in_grid(g, o);
    let direction = direction_in_grid(g, d);
    let inverse = 1.0 / direction;
    let rises = direction > vec3<f32>(0.0);
    let blocks = (g.cells + BLOCK - 1u) / BLOCK;
    // Each step leaves a cell through one of its faces.
    let max_steps = g.cells.x + g.cells.y + g.cells.z;

    var t = first;
    var cell = cell_at(g, origin + t * direction);
    var integral = 0.0;
    // The current step: lower corner of its cell or block, its length, whether the integral reaches `needed` in it, and the density of
    // the block (negative if it is not constant).
    var low = cell;
    var width = 0.0;
    var found = false;
    var density = 0.0;
    for (var i = 0u; i < max_steps && t < last && !found; i++) {
        // A block of constant density takes one step.
        let block = vec3<u32>(cell) / BLOCK;
        density = bitcast<f32>(textureLoad(densities, g.first_block + block.x + blocks.x * (block.y + blocks.y * block.z), 0).x);
        let is_constant = density >= 0.0;
        low = select(cell, vec3<i32>(block * BLOCK), is_constant);
        let high = select(cell + 1, min(vec3<i32>((block + 1u) * BLOCK), vec3<i32>(g.cells)), is_constant);
        let faces = (vec3<f32>(select(low, high, rises)) - origin) * inverse;
        let leave = min(faces.x, min(faces.y, faces.z));
        let end = clamp(leave, t, last);
        width = end - t;
        var amount = density * width;
        if (!is_constant) {
            let c = cell_corners(g, vec3<u32>(cell));
            amount = g.scale * width * cell_integral(c, origin + t * direction - vec3<f32>(low), width * direction);
        }
        found = integral + amount >= needed;
        if (!found) {
            integral += amount;
            // On the axis of the face through which the ray leaves, the ray always enters the neighbour behind this face. So rounding
            // cannot keep the ray in the cell.
            let inside = clamp(vec3<i32>(floor(origin + end * direction)), low, high - 1);
            cell = select(inside, select(low - 1, high, rises), faces <= vec3<f32>(leave));
            let is_outside = any(cell < vec3<i32>(0)) || any(cell >= vec3<i32>(g.cells));
            t = select(end, last, is_outside);
        }
    }
    if (!found) {
        return Passage(last - first, integral);
    }

    let rest = needed - integral;
    if (density >= 0.0) {
        return Passage(t + min(rest / max(density, 1e-37), width) - first, needed);
    }
    // Newton's method for the share of the step at which the integral is `needed`; bisection where it leaves the bracket.
    let c = cell_corners(g, vec3<u32>(cell));
    let start = origin + t * direction - vec3<f32>(low);
    let part = width * direction;
    let wanted = rest / (g.scale * width);
    var bracket = vec2<f32>(0.0, 1.0);
    var x = 0.5;
    for (var i = 0u; i < 8u; i++) {
        let excess = x * cell_integral(c, start, x * part) - wanted;
        bracket = select(vec2<f32>(x, bracket.y), vec2<f32>(bracket.x, x), excess > 0.0);
        let next = x - excess / max(cell_density(c, start + x * part), 1e-20);
        x = select(0.5 * (bracket.x + bracket.y), next, next >= bracket.x && next <= bracket.y);
    }
    return Passage(t + x * width - first, needed);
}
