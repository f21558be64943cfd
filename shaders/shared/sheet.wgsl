// Thin glass: a surface with transmission that bounds no solid, such as a window that is modelled as one plane. Light passes straight on.
// With all reflections between its two faces, a sheet whose faces reflect R reflects R' = 2 R / (1 + R) and transmits
// T' = (1 - R) / (1 + R). The base colour tints the light that passes. Both sides of a sheet are alike.
//
// Smooth sheets are no vertices of paths. Rays pass them as they pass surfaces with alpha: a ray of a subpath passes at random (but see
// below), and a shadow ray always passes, with the share of the light as a factor. A ray that does not pass has hit the rest of the material,
// for example its reflection. Rough sheets are vertices, because they scatter light that passes.
//
// Camera rays split at the first sheet if it is clear: all but a few samples of a pixel pass it with the share of the light as a factor.
// The others stop there. Choosing at random costs more than the samples that do not pass: the number that pass varies in each pixel.
//
// A LiDAR that shares its render with others sees only light that comes straight back. Its rays pass all smooth sheets: what the sheets
// reflect has more segments.
#import bsdf
#import surface

// What a smooth sheet does to a ray that passes it.
struct Sheet {
    // Share of the light that passes, per channel. 0 if no light passes, or if the sheet scatters it.
    share: vec3<f32>,
    // Probability that a ray of a subpath passes: the light that passes, over this light and the light that does not pass.
    probability: f32,
    // Extra travel time of the light that passes.
    delay: f32,
    // Whether the sheet also has lobes that can be connected, as a vertex of a path.
    scatters: bool,
}

// What all sheets on a part of a ray do together.
struct Transit {
    // Factor on the light.
    weight: vec3<f32>,
    // Extra travel time.
    delay: f32,
    // Whether one of the sheets also scatters light.
    scatters: bool,
}

const OPEN_TRANSIT = Transit(vec3<f32>(1.0), 0.0, false);

// A sheet that a ray has passed.
struct SheetCrossing {
    // Distance along the ray.
    t: f32,
    transit: Transit,
}

// Maximum number of sheets per ray in scenes with media. Further sheets count as being at the place of the last one.
const MAX_SHEETS: u32 = 16u;

// How a ray of `trace` that needs a hit treats sheets: it passes at random, as the rays of subpaths do. Or it follows a beam of zero
// radius: it passes all sheets that do not scatter, so that the first vertex of the beam is not random.
var<private> follows_beam: bool = false;
// Whether `trace` goes back along a segment of a subpath, to find the sheets that the subpath has passed there.
var<private> goes_back: bool = false;
// Stratified numbers for the first two sheets that the next ray meets; negative if there are none.
var<private> sheet_numbers: vec2<f32> = vec2<f32>(-1.0);

// Whether the next ray passes the first clear sheet for sure, or stops there. SPLIT_NONE once it has met this sheet.
const SPLIT_NONE: u32 = 0u;
const SPLIT_PASSES: u32 = 1u;
const SPLIT_STOPS: u32 = 2u;
var<private> split: u32 = SPLIT_NONE;
// Least `probability` of a clear sheet. At others, such as half mirrors, the few samples that stop would be too few.
const CLEAR_PROBABILITY: f32 = 0.75;
// The `probability` of the last clear sheet that a ray which `goes_back` has met; 1 if there was none.
var<private> last_clear: f32 = 1.0;

// The sheets that the ray of `trace` has passed. In scenes without media, only the product over all sheets.
var<private> transit: Transit = OPEN_TRANSIT;
var<private> sheet_crossings: array<SheetCrossing, MAX_SHEETS>;
var<private> sheet_count: u32 = 0u;
// 1 / (probability that the ray did not pass) of the sheet that the ray hit, else 1.
var<private> sheet_stop: f32 = 1.0;

fn and_then(a: Transit, b: Transit) -> Transit {
    return Transit(a.weight * b.weight, a.delay + b.delay, a.scatters || b.scatters);
}

fn forget_sheets() {
    transit = OPEN_TRANSIT;
    sheet_count = 0u;
    sheet_stop = 1.0;
}

fn note_sheet(t: f32, next: Transit) {
    transit = and_then(transit, next);
    if (HAS_MEDIA) {
        if (sheet_count < MAX_SHEETS) {
            sheet_crossings[sheet_count] = SheetCrossing(t, next);
            sheet_count += 1u;
        } else {
            sheet_crossings[MAX_SHEETS - 1u].transit = and_then(sheet_crossings[MAX_SHEETS - 1u].transit, next);
        }
    }
}

// The sheets that the last ray has passed before the distance t. Needs HAS_MEDIA.
fn transit_before(t: f32) -> Transit {
    var before = OPEN_TRANSIT;
    for (var i = 0u; i < sheet_count; i++) {
        if (sheet_crossings[i].t < t) {
            before = and_then(before, sheet_crossings[i].transit);
        }
    }
    return before;
}

// The BSDF at a point of a surface, seen from its front.
fn surface_bsdf(s: Surface) -> Bsdf {
    if (HAS_SURFACE_TEXTURES && varies(load_material(s.material))) {
        return make_varying_bsdf(s.material, unpack_point(point_words(s)), true);
    }
    return make_bsdf(s.material, base_color(s).xyz, true);
}

// The sheet at `s` for a ray along `direction` (unit). Between fixed ends, glass of thickness d delays light by
// d (n cos theta' - cos theta), to first order in d, where n is its index and theta' the angle inside.
fn sheet_at(s: Surface, direction: vec3<f32>) -> Sheet {
    let b = surface_bsdf(s);
    let m = load_material(s.material);
    if (!is_delta(b)) {
        return Sheet(vec3<f32>(0.0), 0.0, 0.0, true);
    }
    let cosine = min(abs(dot(s.normal, direction)), 1.0);
    let cosine_inside = sqrt(max(1.0 - (1.0 - cosine * cosine) / square(b.eta_below), 0.0));
    var clear = (1.0 - b.metallic) * b.transmission * (1.0 - glass_reflectance(b, cosine));
    if (is_coated(b)) {
        clear *= square(1.0 - clearcoat_albedo(b, cosine));
    }
    let share = clear * b.base * exp(-m.absorption / max(cosine_inside, 1e-4));
    let most = max_component(share);
    let delay = max(m.thickness * SURROUNDING_IOR * (b.eta_below * cosine_inside - cosine), 0.0);
    // Rays that hit a sheet that shines must find its emission.
    let limit = select(1.0, 0.5, max_component(m.emission) > 0.0);
    let diffuse = b.metallic < 1.0 && b.transmission < 1.0;
    return Sheet(share, min(most / max(most + (1.0 - clear), 1e-30), limit), delay, diffuse || has_rough_clearcoat(m, point_words(s)));
}

// Whether the triangle of `s` has alpha.
fn has_holes(s: Surface) -> bool {
    return HAS_ALPHA && (load_triangle(s.triangle).material & TRIANGLE_ALPHA) != 0u;
}

// Whether camera rays split at the sheet at `s`. A sheet with alpha is not clear: it has holes.
fn is_clear(s: Surface, sheet: Sheet) -> bool {
    return SPLITS_AT_SHEETS && sheet.probability >= CLEAR_PROBABILITY && !has_holes(s);
}

// Whether all rays of subpaths pass the sheet at `s`, with the share of the light as a factor.
fn passes_for_sure(s: Surface, sheet: Sheet) -> bool {
    return HAS_OWN_LASERS && !sheet.scatters && !has_holes(s);
}

// Whether the ray along `direction` (unit) passes the sheet at `s`, which lies at the distance `t`. Notes the sheet if so. `is_shadow`:
// see `trace`. `u`: uniform in [0, 1).
fn passes_sheet(s: Surface, direction: vec3<f32>, t: f32, is_shadow: bool, u: f32) -> bool {
    let sheet = sheet_at(s, direction);
    if (goes_back) {
        // The subpath has passed the sheet or a hole in it; only the mean of both is known.
        let covered = coverage(s);
        let share = vec3<f32>(1.0 - covered) + covered * sheet.share;
        let probability = select(1.0 - covered + covered * sheet.probability, 1.0, passes_for_sure(s, sheet));
        note_sheet(t, Transit(share / max(probability, 1e-30), sheet.delay, sheet.scatters));
        if (is_clear(s, sheet)) {
            last_clear = sheet.probability;
        }
        return true;
    }
    if (sheet.probability <= 0.0) {
        return false;
    }
    if (is_shadow || (follows_beam && !sheet.scatters) || passes_for_sure(s, sheet)) {
        note_sheet(t, Transit(sheet.share, sheet.delay, sheet.scatters));
        return true;
    }
    if (follows_beam) {
        return false;
    }
    if (SPLITS_AT_SHEETS && split != SPLIT_NONE && is_clear(s, sheet)) {
        let passes = split == SPLIT_PASSES;
        split = SPLIT_NONE;
        if (passes) {
            note_sheet(t, Transit(sheet.share, sheet.delay, sheet.scatters));
        }
        return passes;
    }
    let number = select(u, sheet_numbers.x, sheet_numbers.x >= 0.0);
    sheet_numbers = vec2<f32>(sheet_numbers.y, -1.0);
    if (number < sheet.probability) {
        note_sheet(t, Transit(sheet.share / sheet.probability, sheet.delay, sheet.scatters));
        return true;
    }
    sheet_stop = 1.0 / max(1.0 - sheet.probability, 1e-6);
    return false;
}
