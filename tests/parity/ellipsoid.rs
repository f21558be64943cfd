//! `shared/ellipsoid.wgsl` and `ellipsoid_search.wgsl`: curves of ellipsoids in triangles, their density, and the search for triangles.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::parts::{add, diffuse, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::render::albedo::AlbedoTable;
use taugate::internals::render::geometry::Geometry;
use taugate::internals::render::space::RenderSpace;
use taugate::internals::scene::Scene;
use taugate::internals::settings::Emitters;
use taugate::internals::wgsl::layout::constants::PART_LEAVES;

use crate::shader_function::ShaderFunction;
use crate::trace;
use crate::values::{direction, dvec, frame, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&CURVE, &SEARCH, &MAY_MEET, &MEETS, &DRAW];

const CURVE: ShaderFunction = ShaderFunction {
    imports: &["ellipsoid"],
    input: "v: vec3<f32>, length: f32, q: vec3<f32>, u: f32, v0: vec3<f32>, pad0: f32, v1: vec3<f32>, pad1: f32, v2: vec3<f32>, pad2: f32",
    result: "x: vec3<f32>, arc: f32, stretch: f32",
    body: "let e = make_ellipsoid(input.v, input.q, input.length);
        let arcs = arcs_in_triangle(e, input.v0, input.v1, input.v2);
        let weights = point_on_arcs(arcs, input.u);
        let x = input.v0 + weights.x * (input.v1 - input.v0) + weights.y * (input.v2 - input.v0);
        let n = normalize(cross(input.v1 - input.v0, input.v2 - input.v0));
        result.arc = arcs.length; result.x = x;
        result.stretch = inverse_stretch(n, normalize(input.v - x), distance(input.v, x), normalize(input.q - x), distance(input.q, x));",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Input {
    v: [f32; 3],
    length: f32,
    q: [f32; 3],
    u: f32,
    corners: [[f32; 4]; 3],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Got {
    x: [f32; 3],
    arc: f32,
    stretch: f32,
    pad: [f32; 3],
}

/// Two foci, a range of lengths and a triangle.
struct Case {
    foci: [DVec3; 2],
    lengths: [f64; 2],
    corners: [DVec3; 3],
}

impl Case {
    /// A triangle of this size through which ellipsoids of the range pass.
    fn new(pcg: &mut Pcg, size: f64) -> Case {
        let foci = [direction(pcg), 0.8 * direction(pcg)];
        let middle = 1.5 * direction(pcg);
        let corners = [0; 3].map(|_| (middle + size * direction(pcg)).as_vec3().as_dvec3());
        let sum = focal_sum(foci, middle);
        let width = size * pcg.range(0.2, 1.5);
        let lo = (sum - width * pcg.uniform()).max(1.02 * foci[0].distance(foci[1]));
        Case { foci, lengths: [lo, lo + width], corners }
    }

    fn input(&self, length: f64, u: f64) -> Input {
        let [v, q] = self.foci.map(vec3);
        let corners = self.corners.map(|c| [c.x as f32, c.y as f32, c.z as f32, 0.0]);
        Input { v, q, length: length as f32, u: u as f32, corners }
    }

    /// Area of the part of the triangle where the focal sum is in the range, computed with a regular grid.
    fn area(&self) -> f64 {
        const N: usize = 400;
        let [a, b, c] = self.corners;
        let mut inside = 0;
        for i in 0..N {
            for j in 0..N {
                let r = ((i as f64 + 0.5) / N as f64).sqrt();
                let s = (j as f64 + 0.5) / N as f64;
                let x = a + r * ((1.0 - s) * (b - a) + s * (c - a));
                inside += usize::from((self.lengths[0]..self.lengths[1]).contains(&focal_sum(self.foci, x)));
            }
        }
        0.5 * (b - a).cross(c - a).length() * inside as f64 / (N * N) as f64
    }

    /// sqrt(length^2 - |P(q - v)|^2) / (|x - v| |x - q|), where P projects onto the plane of the triangle if `projects`.
    fn stretch(&self, x: DVec3, projects: bool) -> f64 {
        let [a, b, c] = self.corners;
        let n = (b - a).cross(c - a).normalize();
        let [v, q] = self.foci;
        let apart = if projects { (q - v).reject_from_normalized(n) } else { q - v };
        let length2 = focal_sum(self.foci, x).powi(2) - apart.length_squared();
        length2.max(0.0).sqrt() / (x.distance(v) * x.distance(q))
    }
}

fn focal_sum([v, q]: [DVec3; 2], x: DVec3) -> f64 {
    x.distance(v) + x.distance(q)
}

#[test]
fn points_on_curves_have_the_density_of_the_coarea_formula() {
    // A regular grid of lengths and of points per length. Many lengths, because the arc may jump from one length to the next.
    const N: [usize; 2] = [512, 18];
    let mut pcg = Pcg::new(771);
    let kernel = CURVE.compile(&[]);
    let (mut tested, mut rejected) = (0, 0);
    for case in (0..40).map(|i| Case::new(&mut pcg, [2.0, 0.5, 0.1, 0.01][i % 4])) {
        let [lo, hi] = case.lengths;
        let at = |k: usize| {
            let [i, j] = [k / N[1], k % N[1]].map(|i| i as f64 + 0.5);
            case.input(lo + (hi - lo) * i / N[0] as f64, j / N[1] as f64)
        };
        let inputs: Vec<Input> = (0..N[0] * N[1]).map(at).collect();
        let results: Vec<Got> = kernel.run(&inputs, &[frame(|_| ())]);
        let (mut area, mut wrong) = (0.0, 0.0);
        for (input, got) in inputs.iter().zip(&results).filter(|(_, got)| got.arc > 0.0) {
            let x = dvec(&got.x);
            let off = focal_sum(case.foci, x) - f64::from(input.length);
            assert!(off.abs() < 3e-6, "a point lies {off:.1e} beside the ellipsoid");
            let exact = case.stretch(x, true);
            assert!((f64::from(got.stretch) / exact - 1.0).abs() < 1e-3, "{} against {exact}", got.stretch);
            area += (hi - lo) * f64::from(got.arc) / f64::from(got.stretch) / (N[0] * N[1]) as f64;
            wrong += (hi - lo) * f64::from(got.arc) / case.stretch(x, false) / (N[0] * N[1]) as f64;
        }
        let exact = case.area();
        let size = 0.5 * (case.corners[1] - case.corners[0]).cross(case.corners[2] - case.corners[0]).length();
        if exact < 0.1 * size {
            continue;
        }
        tested += 1;
        assert!((area / exact - 1.0).abs() < 0.02, "area {area:.6} against {exact:.6}, {:?}", case.lengths);
        rejected += usize::from((wrong / exact - 1.0).abs() > 0.02);
    }
    assert!(tested > 20, "only {tested} triangles were met");
    assert!(rejected > tested / 3, "only {rejected} of {tested} tell a wrong density");
}

const SEARCH: ShaderFunction = ShaderFunction {
    imports: &["ellipsoid_search"],
    input: "v: vec3<f32>, length: f32, q: vec3<f32>, part: u32",
    result: "triangle: u32, count: u32",
    body: "let search = make_search(input.v, input.q, input.length);
        var choice = TriangleChoice(NONE, 0u);
        search_part(input.part, search, vec4<u32>(id.x, 1u, 2u, 3u), &choice);
        result.triangle = choice.triangle; result.count = choice.count;",
};

const MAY_MEET: ShaderFunction = ShaderFunction {
    imports: &["ellipsoid_search"],
    input: "v: vec3<f32>, length: f32, q: vec3<f32>, triangle: u32",
    result: "may_meet: u32",
    body: "result.may_meet = u32(may_meet(make_search(input.v, input.q, input.length), input.triangle));",
};

/// Draws a point of an ellipsoid by descending the BVH. The foci see all directions. The result is the estimated contribution of
/// the point divided by its density. The mean of the results is the integral of the estimate.
const DRAW: ShaderFunction = ShaderFunction {
    imports: &["ellipsoid_descent"],
    input: "v: vec3<f32>, length: f32, q: vec3<f32>, part: u32",
    result: "triangle: u32, contribution: f32",
    body: "let search = make_search(input.v, input.q, input.length);
        var rng = pcg4d(vec4<u32>(id.x, 17u, 5u, 3u)).y;
        let all = vec3<f32>(0.0);
        let point = draw_on_ellipsoid(search, Focus(input.v, all), Focus(input.q, all), &rng);
        result.triangle = point.triangle;
        if (point.triangle != NONE) {
            let t = load_triangle(point.triangle);
            let x = t.v0 + point.weights.x * (t.v1 - t.v0) + point.weights.y * (t.v2 - t.v0);
            let n = normalize(cross(t.v1 - t.v0, t.v2 - t.v0));
            result.contribution = point.inverse_density * contribution_estimate(x, n, Focus(input.v, all), Focus(input.q, all));
        }",
};

/// Whether the ellipsoid meets a triangle that has both foci on one side, and the integral of the contribution over its arcs.
const MEETS: ShaderFunction = ShaderFunction {
    imports: &["ellipsoid_descent"],
    input: "v: vec3<f32>, length: f32, q: vec3<f32>, triangle: u32",
    result: "meets: u32, integral: f32",
    body: "let t = load_triangle(input.triangle);
        let n = cross(t.v1 - t.v0, t.v2 - t.v0);
        let arcs = arcs_in_triangle(make_ellipsoid(input.v, input.q, input.length), t.v0, t.v1, t.v2);
        for (var i = 0u; i < 256u; i++) {
            let w = point_on_arcs(arcs, (f32(i) + 0.5) / 256.0);
            let x = t.v0 + w.x * (t.v1 - t.v0) + w.y * (t.v2 - t.v0);
            let all = vec3<f32>(0.0);
            let estimate = contribution_estimate(x, normalize(n), Focus(input.v, all), Focus(input.q, all));
            result.integral += select(0.0, arcs.length / 256.0 * estimate, arcs.length > 0.0);
        }
        result.meets = u32(arcs.length > 0.0 && dot(n, input.v - t.v0) * dot(n, input.q - t.v0) > 0.0);",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Sought {
    v: [f32; 3],
    length: f32,
    q: [f32; 3],
    index: u32,
}

#[test]
fn searches_and_descents_find_triangles_as_often_as_they_say() {
    const DRAWS: usize = 20_000;
    // Weights of triangles that are rarely drawn vary much.
    const POINTS: usize = 200_000;
    let scene = trace::scene();
    let mut buffers = vec![frame(|_| ())];
    buffers.extend(trace::buffers(&scene, DVec3::ZERO));
    let geometry = Geometry::new(&scene, &RenderSpace::metres(DVec3::ZERO), &Emitters::Scene, &AlbedoTable::new());
    let parts = geometry.bvh.parts(64);
    assert!(parts.len() > 10 && parts.iter().any(|part| part & PART_LEAVES != 0));
    assert_eq!(geometry.bvh.parts(1 << 20), [0]);
    let (search, meets, draw) = (SEARCH.compile(&[]), MEETS.compile(&[]), DRAW.compile(&[]));
    let mut pcg = Pcg::new(772);
    let (mut met_in_all, mut well_known) = (0, 0);
    for _ in 0..10 {
        let (v, q) = (5.0 * direction(&mut pcg), 5.0 * direction(&mut pcg));
        let length = (v.distance(q) + pcg.range(0.01, 2.0)) as f32;
        let sought = |index: u32| Sought { v: vec3(v), length, q: vec3(q), index };
        let all: Vec<Sought> = (0..geometry.triangles.len() as u32).map(sought).collect();
        let met: Vec<(u32, f32)> =
            meets.run::<_, [f32; 2]>(&all, &buffers).iter().map(|m| (m[0].to_bits(), m[1])).collect();
        // Sums of the contributions on each triangle, and of their squares. The triangle is NONE if none was found.
        let mut sums = vec![[0.0; 2]; met.len()];
        for [triangle, contribution] in draw.run::<_, [f32; 2]>(&vec![sought(0); POINTS], &buffers) {
            if let Some([sum, squares]) = sums.get_mut(triangle.to_bits() as usize) {
                *sum += f64::from(contribution);
                *squares += f64::from(contribution).powi(2);
            }
        }
        for (i, (&(meets, integral), sums)) in met.iter().zip(&sums).enumerate() {
            let [mean, square] = sums.map(|sum| sum / POINTS as f64);
            let integral = if meets == 1 { f64::from(integral) } else { 0.0 };
            let error = (square / POINTS as f64).sqrt();
            assert!(mean == 0.0 || integral > 0.0, "triangle {i} is not met, but drawn");
            if mean == 0.0 || error > 0.015 * mean {
                continue;
            }
            well_known += 1;
            assert!(
                (mean - integral).abs() <= 5.0 * error + 0.01 * integral,
                "triangle {i}: {mean} +- {error} for an integral of {integral}"
            );
        }
        let drawn: Vec<[u32; 2]> = search.run(&vec![sought(0); DRAWS], &buffers);
        let count = drawn[0][1];
        assert!(drawn.iter().all(|d| d[1] == count));
        let in_parts: Vec<[u32; 2]> = search.run(&parts.iter().map(|&part| sought(part)).collect::<Vec<_>>(), &buffers);
        assert_eq!(in_parts.iter().map(|d| d[1]).sum::<u32>(), count, "the parts cover each triangle once");
        let mut times = vec![0usize; all.len()];
        drawn.iter().filter(|d| d[1] > 0).for_each(|d| times[d[0] as usize] += 1);
        let mean = DRAWS as f64 / f64::from(count.max(1));
        for (i, &n) in times.iter().enumerate().filter(|(i, n)| met[*i].0 == 1 || **n > 0) {
            assert!((n as f64 - mean).abs() < 6.0 * mean.sqrt(), "triangle {i} was drawn {n} times of {mean:.0}");
        }
        met_in_all += met.iter().map(|m| m.0).sum::<u32>();
    }
    assert!(met_in_all > 100, "the ellipsoids meet only {met_in_all} triangles");
    assert!(well_known >= 5, "the integrals of only {well_known} triangles are known within 1.5 %");
}

/// The unit of render space may be far larger than the objects. Products of several small lengths then underflowed, and small
/// triangles got lost.
#[test]
fn small_triangles_are_met_in_any_unit() {
    let mut pcg = Pcg::new(773);
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [1.0; 3]));
    // Triangles of 1 mm and smaller, some of them near the ellipsoids.
    for i in 0..60 {
        let size = [1e-3, 1e-5][i % 2];
        let corner = pcg.range(0.5, 1.5) * direction(&mut pcg);
        add(&mut scene, "sheet", white, quad(corner, size * direction(&mut pcg), size * direction(&mut pcg), [1.0; 2]));
    }
    let foci: Vec<[DVec3; 2]> = (0..10).map(|_| [direction(&mut pcg), direction(&mut pcg)]).collect();
    let lengths: Vec<f64> = foci.iter().map(|[v, q]| v.distance(*q) + pcg.range(0.2, 1.0)).collect();
    let kernel = MAY_MEET.compile(&[]);
    let met_in = |unit: f64| -> Vec<u32> {
        let space = RenderSpace { origin: DVec3::ZERO, unit };
        let mut buffers = vec![frame(|_| ())];
        buffers.extend(trace::buffers_in(&scene, &space));
        let sought = |[v, q]: [DVec3; 2], length: f64, index: u32| Sought {
            v: space.point(v).into(),
            length: space.length(length) as f32,
            q: space.point(q).into(),
            index,
        };
        let pairs = foci.iter().zip(&lengths).flat_map(|(&f, &l)| (0..120).map(move |index| sought(f, l, index)));
        kernel.run(&pairs.collect::<Vec<_>>(), &buffers)
    };
    let in_metres = met_in(1.0);
    let met = in_metres.iter().filter(|&&met| met == 1).count();
    assert!(met > 50 && met < 1000, "{met} of {} triangles may be met", in_metres.len());
    for exponent in [-19, 19, 26] {
        let other = met_in(f64::from(exponent).exp2());
        let wrong = other.iter().zip(&in_metres).filter(|(a, b)| a != b).count();
        assert_eq!(wrong, 0, "answers of {wrong} triangles change in units of 2^{exponent} m, {met} are met in metres");
    }
}
