//! `shared/weights.wgsl`: on every path, the MIS weights of all kept strategies sum to 1.
//!
//! The test kernel walks a path of given vertices from both ends with the functions of the renderer, and computes the weight
//! of every strategy. No sampling is involved, so the sum is 1 up to rounding, and a missing strategy shows.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::wgsl::layout::Medium;

use crate::materials::set;
use crate::scatter::buffers;
use crate::shader_function::{CompiledFunction, ShaderFunction, contents};
use crate::values::{direction, frame, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&WEIGHTS];

/// Maximum number of segments of a path.
const LONGEST: usize = 6;

const WEIGHTS: ShaderFunction = ShaderFunction {
    imports: &["walk", "weights", "segment"],
    input: "place: array<vec4<f32>, 6>, geometric: array<vec4<f32>, 6>, normal: array<vec4<f32>, 6>, segments: u32, kind: u32,
        density: f32, select_pdf: f32",
    result: "weights: array<f32, 12>",
    body: "var path = input; let k = path.segments; let beam = path.kind == 4u || path.kind == 5u;
        let area = path.kind <= 1u; let from_sky = path.kind == 6u;
        var lights: array<PathVertex, 6>; var sensors: array<PathVertex, 6>;
        // Scattering towards the next vertex of the path. Each kind has one call, because calls of BSDFs take long to compile.
        var to_sensor: array<Evaluation, 6>; var to_emitter: array<Evaluation, 6>;
        let seen = segment_to_sensor(path.place[k - 1u].xyz, vec2<f32>(0.0));
        for (var i = 0u; i < 12u; i++) { result.weights[i] = -1.0; }

        // From the emitter.
        var e: Emission; e.vertex.position = path.place[0].xyz; e.vertex.geometric = path.geometric[0].xyz;
        e.vertex.select_pdf = path.select_pdf; e.vertex.flags = VERTEX_EMITTER | VERTEX_VALID | select(VERTEX_DETERMINISTIC, 0u, area); e.vertex.eta = 1.0;
        e.vertex.material = path.kind; e.density = path.density; e.stored = area; e.beam = beam;
        e.sky = from_sky; e.parallel = from_sky; if (from_sky) { e.vertex.select_pdf = load_sky().select_pdf; }
        var light: PathState; light.position = path.place[0].xyz; light.eta = 1.0;
        if (k > 1u) { light.direction = normalize(path.place[1].xyz - path.place[0].xyz); }
        e.direction = light.direction;
        if (!beam) {
            e.pdf_direction = select(emitter_profile(e.vertex, e.direction).y, load_sky().disk_pdf, from_sky);
            start_light_sums(&light, e);
        }
        light.flags = select(0u, PATH_PARALLEL, from_sky) | select(0u, PATH_LEAVES_CONNECTED, !area && !beam && !from_sky);
        if (area) { e.vertex.d_vcm = emitter_point_sum(e.density); e.vertex.select_pdf = 1.0; }
        e.vertex.flags |= u32(area) << VERTEX_RANDOM_SHIFT; lights[0] = e.vertex;
        var deterministic = path.kind == 5u; var random = select(u32(area), 2u, from_sky);
        for (var i = 0u; i < k; i++) {
            var v = lights[i];
            if (i > 0u) {
                let d = distance(path.place[i].xyz, light.position);
                let depth = optical_depths(light.position, light.direction, d).scattering;
                if ((light.flags & PATH_PARALLEL) == 0u) { light.d_vcm = min(light.d_vcm / mis(flight_density(depth)), MAX_SUM); }
                if (path.place[i].w > 0.0) {
                    v = arrive_in_medium(&light, Flight(true, d, 0u, vec3<f32>(1.0), depth));
                    v.flags |= select(0u, VERTEX_FOLLOWS_CONNECTED, (light.flags & PATH_LEAVES_CONNECTED) != 0u);
                    deterministic = false;
                } else {
                    var surface: Surface; surface.position = path.place[i].xyz; surface.geometric = path.geometric[i].xyz;
                    surface.normal = path.normal[i].xyz; surface.material = bitcast<u32>(path.normal[i].w);
                    find_solid(&light, surface);
                    v = arrive(&light, surface);
                }
                if (HAS_ELLIPSOIDS && i > 1u) { add_auxiliary_sum(&v, lights[i - 1u]); }
                if (deterministic) { v.select_pdf = path.select_pdf; v.flags |= VERTEX_DETERMINISTIC; }
                random = select(min(random + 1u, 3u), 0u, deterministic); v.flags |= random << VERTEX_RANDOM_SHIFT;
                lights[i] = v;
            }
            light.direction = seen.direction;
            if (i + 1u < k) { light.direction = normalize(path.place[i + 1u].xyz - path.place[i].xyz); }
            let c = evaluate_light_vertex(v, light.direction);
            to_sensor[i] = c;
            if (i > 0u && i + 1u < k) {
                var s: Scatter; s.pdf = c.pdf / selection_pdf(v); s.pdf_reverse = c.pdf_reverse; s.cosine = c.cosine;
                s.delta = !is_connectible(v);
                if (follows_connected(v)) { light.d_vcm = min(light.d_vcm * mis(density_gain(v.material, v.to_previous, light.direction)), MAX_SUM); }
                mis_scatter(&light, v, s, sample_count_ratio(v) * selection_pdf(v));
                let leaves_connected = deterministic && !s.delta && light.d_vcm > 0.0;
                light.flags = (light.flags & ~PATH_LEAVES_CONNECTED) | select(0u, PATH_LEAVES_CONNECTED, leaves_connected);
                deterministic = deterministic && s.delta;
            }
        }

        // From the sensor.
        var sensor: PathState; sensor.eta = 1.0; sensor.position = seen.end; sensor.direction = -seen.direction;
        if (HAS_ORTHOGRAPHIC) { sensor.flags = PATH_PARALLEL; }
        start_sensor_sums(&sensor, dot(sensor.direction, frame.forward), sensor.direction);
        for (var n = 0u; n < k; n++) {
            let j = k - 1u - n;
            if (from_sky && j == 0u) {
                if (frame.keep_s0 > 0.0) { result.weights[0] = sky_escape_weight(sensor, k, path.density); }
                break;
            }
            let d = distance(path.place[j].xyz, sensor.position);
            let depth = optical_depths(sensor.position, sensor.direction, d).scattering;
            if ((sensor.flags & PATH_PARALLEL) == 0u) { sensor.d_vcm = min(sensor.d_vcm / mis(flight_density(depth)), MAX_SUM); }
            var q: PathVertex;
            if (path.place[j].w > 0.0) {
                q = arrive_in_medium(&sensor, Flight(true, d, 0u, vec3<f32>(1.0), depth));
            } else {
                var surface: Surface; surface.position = path.place[j].xyz; surface.geometric = path.geometric[j].xyz;
                surface.normal = path.normal[j].xyz; surface.material = bitcast<u32>(path.normal[j].w);
                find_solid(&sensor, surface);
                q = arrive(&sensor, surface);
            }
            q.flags |= n + 1u;
            if (HAS_ELLIPSOIDS && n > 1u) { add_auxiliary_sum(&q, sensors[j + 1u]); }
            sensors[j] = q;
            if (j > 0u) {
                sensor.direction = normalize(path.place[j - 1u].xyz - path.place[j].xyz);
                let c = evaluate_shade_point(q, sensor.direction);
                to_emitter[j] = c;
                var s: Scatter; s.pdf = c.pdf; s.pdf_reverse = c.pdf_reverse; s.cosine = c.cosine;
                s.delta = !is_connectible(q);
                mis_scatter(&sensor, q, s, 1.0);
            }
        }

        // All strategies.
        if (area && frame.keep_s0 > 0.0) {
            let emitted = emitter_profile(e.vertex, e.direction).y;
            result.weights[0] = emitter_weight(sensors[0], k, path.density, emitted);
        }
        for (var s = 1u; s < k; s++) {
            let v = lights[s - 1u]; var q = sensors[s];
            // On the first segment, light subpaths do not form the events that are drawn in the gate (shared/fog.wgsl).
            if (is_in_medium(q) && is_drawn_in_gate(v) && s + 1u == k && !from_sky) { q.d_vcm = 0.0; }
            let stands = select(is_connectible(v), !beam, s == 1u) && is_connectible(q);
            if (stands && (s == 1u || frame.keep_s2 > 0.0)) {
                let between = segment_between(q.position, v.position);
                let reached = flight_density(segment_depths(q, between.direction, sqrt(between.length2)).scattering);
                result.weights[s] = connection_weight(q, v, to_emitter[s], to_sensor[s - 1u], between.length2 / reached);
                if (from_sky && s == 1u) {
                    result.weights[s] = sky_connection_weight(q, to_emitter[s], path.density);
                }
            }
        }
        for (var i = 1u; i + 1u < k && HAS_ELLIPSOIDS; i++) {
            let v = lights[i - 1u]; let q = sensors[i + 1u]; var x = sensors[i];
            if (select(is_connectible(v), !beam, i == 1u) && is_connectible(x) && is_connectible(q)) {
                let to_v = segment_between(x.position, v.position); let to_q = segment_between(x.position, q.position);
                result.weights[6u + i] = ellipsoidal_weight(q, v, x, to_emitter[i + 1u], to_sensor[i - 1u], to_emitter[i],
                    vec2<f32>(to_v.length2, to_q.length2), to_v.direction, sqrt(to_v.length2), to_q.direction, sqrt(to_q.length2));
            }
        }
        if (k > 1u && frame.keep_t1 > 0.0 && is_connectible(lights[k - 1u]) && !follows_connected(lights[k - 1u])) {
            let v = lights[k - 1u]; let c = to_sensor[k - 1u];
            let reached = flight_density(segment_depths(v, seen.direction, seen.length).scattering);
            let density = pixel_pdf(dot(-seen.direction, frame.forward), -seen.direction) * select(reached, 1.0, HAS_ORTHOGRAPHIC);
            let spread = select(seen.length * seen.length, 1.0, HAS_ORTHOGRAPHIC);
            result.weights[k] = splat_weight(v, c, density * c.cosine / spread);
        }",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Path {
    /// Position; last 1 for a scattering event in fog, otherwise 0.
    place: [[f32; 4]; LONGEST],
    geometric: [[f32; 4]; LONGEST],
    normal: [[f32; 4]; LONGEST],
    segments: u32,
    kind: u32,
    density: f32,
    select_pdf: f32,
}

/// Kinds of emitters: a surface that emits on one side or on both, a point, a beam with a radius and a beam without one, the sky.
const KINDS: [u32; 6] = [0, 1, 2, 4, 5, 6];

/// A random path. Both neighbours of a vertex are in front of its surface. If the path `crosses` glass, this holds for three
/// quarters of the vertices, and at the others the path passes through rough glass. Shading normals differ from the geometric
/// ones, and a quarter of the vertices are mirrors. In `fog`, a third of the vertices are scattering events.
fn path(pcg: &mut Pcg, kind: u32, segments: usize, Paths { orthographic, crosses, fog }: Paths) -> Path {
    let set = set();
    let glass = set.named("rough glass", 1.0) as u32;
    // Not the emitter, which is the last place from the sensor.
    let is_crossed: Vec<bool> = (0..segments).map(|n| crosses && n > 0 && pcg.below(4) == 0).collect();
    let wide: Vec<u32> = (0..set.kinds.len() as u32).filter(|&i| set.kinds[i as usize].roughness > 0.4).collect();
    let mirror = set.named("mirror", 0.0) as u32;
    let mut places = vec![DVec3::ZERO];
    for n in 0..segments {
        let towards = match n {
            0 if orthographic => DVec3::NEG_Z,
            0 => (direction(pcg) + 2.0 * DVec3::NEG_Z).normalize(),
            // Facets refract only into directions near the straight one.
            _ if is_crossed[n] => ((places[n] - places[n - 1]).normalize() + 0.4 * direction(pcg)).normalize(),
            _ => direction(pcg),
        };
        places.push(places[n] + pcg.range(0.5, 2.0) * towards);
    }
    places.reverse();
    let mut path = Path { segments: segments as u32, kind, ..Zeroable::zeroed() };
    path.density = pcg.range(0.2, 2.0) as f32;
    path.select_pdf = pcg.range(0.2, 1.0) as f32;
    for i in 0..segments {
        let ahead = (places[i + 1] - places[i]).normalize();
        let behind = if i == 0 { ahead } else { (places[i - 1] - places[i]).normalize() };
        let crossed = is_crossed.get(segments - i).is_some_and(|&crossed| crossed);
        let behind = if crossed { -behind } else { behind };
        // Both neighbours are in front of a surface with this normal, or one in front of it and one behind it.
        let side = if crossed && pcg.below(2) == 0 { -1.0 } else { 1.0 };
        let between = side * (ahead + behind).normalize();
        let facing = |n: DVec3| side * n.dot(ahead) > 0.05 && side * n.dot(behind) > 0.05;
        let spread = if crossed { 0.2 } else { 0.5 };
        let near = |pcg: &mut Pcg| {
            let tries = (0..100).map(|_| (between + spread * direction(pcg)).normalize());
            tries.collect::<Vec<_>>().into_iter().find(|&n| facing(n)).unwrap_or(between)
        };
        let (geometric, normal) = (near(pcg), near(pcg));
        let material = match i > 0 && pcg.below(4) == 0 {
            _ if crossed => glass,
            true => mirror,
            false => wide[pcg.below(wide.len())],
        };
        let four = |v: DVec3, w: f32| [vec3(v)[0], vec3(v)[1], vec3(v)[2], w];
        let is_event = fog && i > 0 && pcg.below(3) == 0;
        path.place[i] = four(places[i], f32::from(u8::from(is_event)));
        path.geometric[i] = four(geometric, 0.0);
        path.normal[i] = four(normal, f32::from_bits(material));
    }
    path
}

/// Which paths a test draws.
#[derive(Clone, Copy, Default)]
struct Paths {
    orthographic: bool,
    crosses: bool,
    fog: bool,
}

/// Strategies that a render keeps: s = 0, t = 1, and s >= 2 (s = 1 is always kept).
const KEPT: [[f32; 3]; 4] = [[1.0, 1.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]];

/// The weights of all strategies for every path, indexed by s; -1 where a strategy is not formed. `sample_count` is the
/// number of samples that the connection strategy takes at a random light vertex.
fn weights(kernel: &CompiledFunction, kept: [f32; 3], sample_count: f32, paths: &[Path]) -> Vec<[f32; 12]> {
    // If two buffers have the same name, the first is bound. `buffers` also returns a `frame`.
    let mut all = vec![frame(|f| {
        f.forward = [0.0, 0.0, -1.0];
        (f.pixel_area, f.splat_sample_count) = (0.05, 3.0);
        f.query_sample_count = sample_count;
        [f.keep_s0, f.keep_t1, f.keep_s2] = [kept[0] / sample_count.powi(2), kept[1] / sample_count.powi(2), kept[2]];
        (f.min_detour, f.auxiliary_density) = (0.3, 0.2);
        (f.media_count, f.gate_lo, f.gate_hi) = (1, 3.0, 3.2);
    })];
    let fog = Medium { lo: [-3e38; 3], hi: [3e38; 3], sigma_s: [0.9, 0.6, 0.3], g: 0.5, ..Zeroable::zeroed() };
    all.push(contents("media", &[fog]));
    all.push(contents("sky", &[1u32, 1, 0.3f32.to_bits(), 0.7f32.to_bits()]));
    all.extend(buffers());
    kernel.run(paths, &all)
}

/// Indices of the paths whose weights do not sum to 1 if the strategy s = `without` is left out, and the number of paths for
/// which that strategy was formed. If `length` is given, only paths with this many segments count.
fn wrong(
    results: &[[f32; 12]],
    segments: &[usize],
    without: Option<usize>,
    length: Option<usize>,
) -> (Vec<usize>, usize) {
    let mut formed = 0;
    let offends = |i: &usize| {
        let w = &results[*i];
        if length.is_some_and(|k| segments[*i] != k) || w.iter().all(|&x| x < 0.0) {
            return false;
        }
        formed += usize::from(without.is_none_or(|s| w[s] >= 0.0));
        let kept = w.iter().enumerate().filter(|(s, x)| **x >= 0.0 && Some(*s) != without);
        let sum: f64 = kept.map(|(_, &x)| f64::from(x)).sum();
        // NaN compares false, so it needs its own test.
        sum.is_nan() || (sum - 1.0).abs() > 1e-4
    };
    ((0..results.len()).filter(offends).collect(), formed)
}

#[test]
fn weights_of_a_path_sum_to_one() {
    sum_to_one(Paths::default(), &[]);
}

#[test]
fn weights_of_a_path_through_rough_glass_sum_to_one() {
    sum_to_one(Paths { crosses: true, ..Paths::default() }, &[]);
}

/// `cargo test --release --test parity -- --ignored orthographic`
#[test]
#[ignore = "takes ten seconds; parallel views are compared with the oracle always"]
fn weights_of_a_path_to_an_orthographic_camera_sum_to_one() {
    sum_to_one(Paths { orthographic: true, ..Paths::default() }, &[("HAS_ORTHOGRAPHIC", 1.0)]);
}

/// With and without events that are drawn in the gate. The sky does not shine through a medium that fills all space, but its strategies
/// do not depend on the extent of the medium.
#[test]
fn weights_of_a_path_in_fog_sum_to_one() {
    for draws_in_gate in [0.0, 1.0] {
        let constants = [("HAS_NULL_BOUNDARIES", 0.0), ("HAS_INTERIORS", 0.0), ("HAS_GRIDS", 0.0)];
        sum_to_one(
            Paths { fog: true, ..Paths::default() },
            &[&constants[..], &[("DRAWS_IN_GATE", draws_in_gate)]].concat(),
        );
    }
}

fn sum_to_one(drawn: Paths, constants: &[(&str, f64)]) {
    let mut pcg = Pcg::new(151);
    let segments: Vec<usize> = (0..6000).map(|i| if i % 60 == 0 { 1 } else { 2 + pcg.below(LONGEST - 1) }).collect();
    let kinds: Vec<u32> = (0..6000).map(|_| KINDS[pcg.below(KINDS.len())]).collect();
    // A path of one segment sees the emitter itself, which must be a surface.
    let kinds: Vec<u32> = kinds.iter().zip(&segments).map(|(&kind, &k)| if k == 1 { kind % 2 } else { kind }).collect();
    let paths: Vec<Path> = kinds.iter().zip(&segments).map(|(&kind, &k)| path(&mut pcg, kind, k, drawn)).collect();
    let kernel = WEIGHTS.compile(constants);
    for (kept, sample_count) in KEPT.into_iter().flat_map(|kept| [1.0, 4.0].map(|sample_count| (kept, sample_count))) {
        let results = weights(&kernel, kept, sample_count, &paths);
        let (offenders, formed) = wrong(&results, &segments, None, None);
        let shown: Vec<_> = offenders.iter().take(3).map(|&i| (kinds[i], segments[i], results[i])).collect();
        assert!(
            offenders.is_empty(),
            "{kept:?}, sample_count {sample_count}: {} of {formed}: {shown:?}",
            offenders.len()
        );
        assert!(formed > 1000, "{kept:?}: only {formed} paths");
        // Leaving out one strategy must fail.
        for k in 1..=LONGEST {
            for s in 0..=k {
                let (offenders, formed) = wrong(&results, &segments, Some(s), Some(k));
                assert!(formed == 0 || !offenders.is_empty(), "{kept:?}: s = {s} of {k} segments may be missing");
                let all = kept == KEPT[0] && (s, k) != (1, 1);
                assert!(!all || formed > 50, "s = {s} of {k} segments was formed only {formed} times");
            }
        }
    }
}

/// The same with ellipsoidal connections. Results 7 to 10 are the weights of connections through auxiliary vertices 1 to 4.
#[test]
fn weights_with_ellipsoidal_connections_sum_to_one() {
    let mut pcg = Pcg::new(152);
    let segments: Vec<usize> = (0..6000).map(|_| 2 + pcg.below(LONGEST - 1)).collect();
    let kinds: Vec<u32> = segments.iter().map(|_| KINDS[pcg.below(5)]).collect();
    let paths: Vec<Path> =
        kinds.iter().zip(&segments).map(|(&kind, &k)| path(&mut pcg, kind, k, Paths::default())).collect();
    let kernel = WEIGHTS.compile(&[("HAS_ELLIPSOIDS", 1.0)]);
    for sample_count in [1.0, 4.0] {
        let results = weights(&kernel, KEPT[0], sample_count, &paths);
        let (offenders, formed) = wrong(&results, &segments, None, None);
        let shown: Vec<_> = offenders.iter().take(3).map(|&i| (kinds[i], segments[i], results[i])).collect();
        assert!(offenders.is_empty(), "sample_count {sample_count}: {} of {formed}: {shown:?}", offenders.len());
        for (k, i) in (3..=LONGEST).flat_map(|k| (1..k - 1).map(move |i| (k, i))) {
            let (offenders, formed) = wrong(&results, &segments, Some(6 + i), Some(k));
            assert!(
                formed > 200 && offenders.len() > 100,
                "auxiliary vertex {i} of {k} segments: {} of {formed}",
                offenders.len()
            );
        }
    }
}
