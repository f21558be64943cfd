//! Degenerate pairs of a shade point and a light vertex: at one place, close together, in one plane, or behind each other.
//!
//! The pairs run through the whole kernels `shell_query`, `shell_resample` and `connect`. Contributions must be finite and
//! not negative. They must equal Eq. 25 with its MIS weight in f64. Only if a vertex is seen almost along its surface, a
//! contribution may be 0 instead.

use std::f64::consts::PI;

use bytemuck::Zeroable;
use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::{parts, shapes};
use taugate::internals::gpu::{Buffer, Device, Kernel, Recorder};
use taugate::internals::lightcone::tree::{Item, Tree, TreeOptions};
use taugate::internals::render::albedo::AlbedoTable;
use taugate::internals::render::leaf_record;
use taugate::internals::scene::{Material, Scene};
use taugate::internals::wgsl::layout::constants::*;
use taugate::internals::wgsl::layout::{Candidate, Dispatch, Frame, NONE, PathVertex};

use crate::device::device;
use crate::shader_function::{Contents, contents};
use crate::trace::buffers;
use crate::values::{direction, dvec, vec3};

const BASE: f32 = 0.5;
const QUERIES: u32 = 8;

/// Distances between the vertices of a pair, in metres.
const DISTANCES: [f64; 9] = [0.0, 1e-7, 3e-7, 1e-6, 1e-5, 1e-4, 1e-3, 0.1, 1.0];

/// A vertex on a diffuse surface. The path reached it from the side of its normal.
fn vertex(position: DVec3, normal: DVec3, sums: [f32; 2], pcg: &mut Pcg) -> PathVertex {
    let mut to_previous = direction(pcg);
    to_previous *= to_previous.dot(normal).signum();
    PathVertex {
        position: vec3(position),
        tau: 2.0,
        throughput: [0.3, 1.0, 0.1],
        normal: vec3(normal),
        geometric: vec3(normal),
        to_previous: vec3(to_previous),
        point_words: [BASE.to_bits(); 3],
        d_vcm: sums[0],
        d_vc: sums[1],
        eta: 1.0,
        offset: 2e-6,
        select_pdf: 1.0,
        flags: 1 | VERTEX_VALID | 0x400,
        ..Zeroable::zeroed()
    }
}

/// Shade points, and for each a light vertex: facing each other, in one plane, behind each other, or in a corner. In a fifth
/// of the pairs, the shade point is level with the pinhole (z = 0), and the vertices differ only in z. All pairs share twelve
/// places, so that vertices of different pairs are close too.
fn pairs() -> (Vec<PathVertex>, Vec<PathVertex>) {
    let mut pcg = Pcg::new(191);
    let (mut points, mut lights) = (vec![], vec![]);
    let places: Vec<DVec3> =
        (0..12).map(|_| DVec3::new(pcg.range(-1.0, 1.0), pcg.range(-1.0, 1.0), pcg.range(-1.0, 1.0))).collect();
    for i in 0..2000 {
        let near_pinhole = i % 5 == 4;
        let w = if near_pinhole { DVec3::Z } else { direction(&mut pcg) };
        let across = w.any_orthonormal_vector();
        let (at_q, at_v) = match (i / 5) % 4 {
            0 => (w + 0.5 * direction(&mut pcg), -w + 0.5 * direction(&mut pcg)),
            1 => (across, across),
            2 => (-w + 0.5 * direction(&mut pcg), w + 0.5 * direction(&mut pcg)),
            _ => (w + across, -w + across),
        };
        let distance = if near_pinhole { 10f64.powf(pcg.range(-36.0, 0.0)) } else { DISTANCES[pcg.below(9)] };
        let middle = places[pcg.below(12)];
        let q = if near_pinhole { DVec3::new(middle.x, middle.y, 0.0) } else { middle };
        let q = q.as_vec3().as_dvec3();
        // After a mirror, both partial sums may be 0.
        let sums = [[0.0, 0.0], [0.7, 0.0], [0.4, 2.0]][pcg.below(3)];
        points.push(PathVertex {
            owner: i,
            ..vertex(q, at_q.normalize(), [[0.0, 0.0], [0.5, 1.0]][pcg.below(2)], &mut pcg)
        });
        let mut light = vertex(q + distance * w, at_v.normalize(), sums, &mut pcg);
        if i % 7 == 0 {
            // A vertex on an emitter.
            (light.flags, light.material, light.tau) = (VERTEX_EMITTER | VERTEX_VALID, 0, 0.0);
        }
        lights.push(light);
    }
    (points, lights)
}

/// Eq. 25 with its MIS weight, for two diffuse vertices. Also returns the smaller of the two cosines.
fn exact(q: &PathVertex, v: &PathVertex) -> (DVec3, f64) {
    let offset = dvec(&v.position) - dvec(&q.position);
    let (d2, w) = (offset.length_squared(), offset.normalize_or_zero());
    let cos_q = dvec(&q.geometric).dot(w);
    let cos_v = -dvec(&v.geometric).dot(w);
    let known = |x: &PathVertex| dvec(&x.geometric).dot(dvec(&x.to_previous));
    let mis = |x: f64| x * x;
    let emitter = v.flags & VERTEX_EMITTER != 0;
    let f_q = f64::from(BASE) / PI * cos_q.max(0.0);
    let f_v = if emitter { 1.0 } else { f64::from(BASE) / PI } * cos_v.max(0.0);
    let q_to_v = cos_q.abs() / PI * cos_v.abs() / d2;
    let v_to_q = cos_v.abs() / PI * cos_q.abs() / d2;
    let back = |x: &PathVertex, pdf: f64| f64::from(x.d_vcm) + f64::from(x.d_vc) * mis(pdf);
    let at_v = back(v, if emitter { 0.0 } else { known(v) / PI });
    let weight = 1.0 / (1.0 + mis(q_to_v) * at_v + mis(v_to_q) * back(q, known(q) / PI));
    let phi = dvec(&q.throughput) * dvec(&v.throughput);
    (phi * (f_q * f_v / d2 * weight), cos_q.min(cos_v))
}

/// A device, and the scene buffers and constants of the kernels.
struct Bench {
    device: Device,
    scene: Vec<Contents>,
    constants: [(&'static str, f64); 7],
}

impl Bench {
    /// A scene with one far surface, so that nothing occludes any pair. All vertices have `material`.
    fn new(material: Material, glossy: bool) -> Bench {
        let mut scene = Scene::default();
        let number = parts::material(&mut scene, material);
        let far = shapes::quad(DVec3::splat(50.0), DVec3::X, DVec3::Y, [1.0; 2]);
        parts::add(&mut scene, "far", number, far);
        let glossy = f64::from(u8::from(glossy));
        let mut scene = buffers(&scene, DVec3::ZERO);
        scene.extend([contents("albedo_table", &AlbedoTable::new().texels), contents("sky", &[0u32; 4])]);
        scene.extend([
            contents("media", &[0u32; 20]),
            contents("phase_tables", &[0u32; 4]),
            contents("grids", &[0u32; 20]),
            contents("densities", &[0u32; 4]),
            contents("segments", &[0u32; 8]),
        ]);
        Bench {
            device: device(),
            scene,
            constants: [
                ("HAS_TEXTURES", 0.0),
                ("HAS_ALPHA", 0.0),
                ("HAS_GLOSSY", glossy),
                ("HAS_TRANSMISSION", glossy),
                ("HAS_SKY", 0.0),
                ("HAS_MEDIA", 0.0),
                ("ESTIMATOR", ESTIMATOR_LCS_PAPER.into()),
            ],
        }
    }

    /// Runs `kernel` with `threads` threads. Returns the contents of the buffers that `out` names.
    fn run(&self, kernel: &'static str, threads: usize, extra: &[Contents], out: &[&'static str]) -> Vec<Vec<u8>> {
        let compiled = Kernel::new(&self.device, kernel, kernel, &self.constants).unwrap_or_else(|e| panic!("{e}"));
        let owned: Vec<(&str, Buffer)> = (self.scene.iter().chain(extra))
            .map(|c| (c.name(), Buffer::from_slice(&self.device, "test", c.bytes(), "").expect("upload")))
            .collect();
        let all: Vec<(&str, &Buffer)> = owned.iter().map(|(name, buffer)| (*name, buffer)).collect();
        let bindings = compiled.bind(&all).unwrap_or_else(|e| panic!("{e}"));
        let mut recorder = Recorder::new(&self.device).expect("recorder");
        let dispatch = Dispatch { count: threads as u32, bounce: 1, ..Zeroable::zeroed() };
        recorder.dispatch("test", &compiled, &bindings, &dispatch, compiled.groups(threads)).expect("dispatch");
        recorder.submit().expect("submit");
        let read = |name: &&str| {
            let (_, buffer) = owned.iter().find(|(n, _)| n == name).expect("an output");
            buffer.to_vec(buffer.size() as usize).expect("reading")
        };
        out.iter().map(read).collect()
    }

    /// Runs `connect`. Returns the contributions of all slots of all shade points.
    fn connect(
        &self,
        frame: Frame,
        points: &[PathVertex],
        lights: &[PathVertex],
        chosen: &[Candidate],
    ) -> Vec<[f32; 4]> {
        let live: Vec<u32> = (0..chosen.len() as u32).filter(|&i| chosen[i as usize].vertex != NONE).collect();
        let every: Vec<u32> = (0..points.len() as u32).collect();
        let extra = [
            contents("frame", &[frame]),
            contents("light_vertices", lights),
            contents("shade_points", points),
            contents("tile_samples", &one_each(points.len())),
            contents("shade_list", &every),
            contents("slot_list", &live),
            contents("counters", &[live.len() as u32]),
            contents("candidates", chosen),
            contents("contributions", &vec![[0.0f32; 4]; chosen.len()]),
        ];
        let out = self.run("connect", live.len(), &extra, &["contributions"]);
        bytemuck::pod_collect_to_vec(&out[0])
    }

    /// Runs a query kernel. Returns the candidates in all slots of all shade points; empty slots have weight 0. `lights` is sorted into the order of the
    /// trees, and the tree fields of `frame` are filled in.
    fn query(
        &self,
        kernel: &'static str,
        frame: &mut Frame,
        points: &[PathVertex],
        lights: &mut Vec<PathVertex>,
    ) -> Vec<Candidate> {
        let lcs = kernel == "shell_resample";
        let (emitters, scattered): (Vec<PathVertex>, Vec<PathVertex>) =
            lights.iter().partition(|v| v.flags & VERTEX_EMITTER != 0);
        let options = TreeOptions { leaf_size: if lcs { 8 } else { 1 }, buckets: 8, first_node: 0, first_vertex: 0 };
        let mut items = [items(&emitters), items(&scattered)];
        let tree3 = Tree::build(&mut items[0], options);
        let first = (tree3.nodes.len() as u32, emitters.len() as u32);
        let tree4 = Tree::build(&mut items[1], TreeOptions { first_node: first.0, first_vertex: first.1, ..options });
        *lights = items[0].iter().map(|i| emitters[i.index as usize]).collect();
        lights.extend(items[1].iter().map(|i| scattered[i.index as usize]));
        (frame.tree3_root, frame.tree4_root, frame.queries) = (tree3.root, tree4.root, QUERIES);
        // More slots than one mark holds.
        frame.slots = if lcs { 2 } else { 2 * QUERIES + SLOTS_PER_MARK };
        let slots = points.len() * frame.slots as usize;
        let words = frame.slots.div_ceil(SLOTS_PER_MARK) as usize;
        let every: Vec<u32> = (0..points.len() as u32).collect();
        let extra = [
            contents("frame", &[*frame]),
            contents("light_vertices", lights),
            contents("leaf_records", &lights.iter().map(leaf_record).collect::<Vec<_>>()),
            contents("tree_nodes", &[tree3.nodes, tree4.nodes].concat()),
            contents("path_offsets", &[0u32; 4]),
            contents("shade_points", points),
            contents("tile_samples", &one_each(points.len())),
            contents("list", &every),
            contents("counters", &[points.len() as u32]),
            contents("candidates", &vec![Candidate::zeroed(); slots]),
            contents("marks", &vec![0u32; points.len() * words]),
            contents("tallies", &vec![[0u32; 4]; points.len()]),
        ];
        let out = self.run(kernel, points.len(), &extra, &["candidates", "marks"]);
        let mut candidates: Vec<Candidate> = bytemuck::pod_collect_to_vec(&out[0]);
        let marks: Vec<u32> = bytemuck::pod_collect_to_vec(&out[1]);
        for (slot, candidate) in candidates.iter_mut().enumerate() {
            let [rank, number] = [slot / frame.slots as usize, slot % frame.slots as usize];
            let mark = marks[rank * words + number / SLOTS_PER_MARK as usize];
            if mark >> (number % SLOTS_PER_MARK as usize) & 1 == 0 {
                *candidate = Candidate { vertex: NONE, weight: 0.0 };
            }
        }
        candidates
    }
}

/// One sample per pixel, in the order of a tile: blocks of 8 x 8 pixels.
fn one_each(pixels: usize) -> Vec<[u32; 2]> {
    let film_pixel = |i: u32| (i % 64 / 8) << 16 | (i / 64 * 8 + i % 8);
    (0..pixels as u32).map(|i| [film_pixel(i), 0]).collect()
}

fn items(vertices: &[PathVertex]) -> Vec<Item> {
    let item = |(i, v): (usize, &PathVertex)| {
        let [x, y, z] = v.position;
        Item { point: [x, y, z, v.tau], power: 1.0, index: i as u32 }
    };
    vertices.iter().enumerate().map(item).collect()
}

fn frame() -> Frame {
    Frame {
        gate_hi: 3e38,
        max_depth: 10,
        light_paths: 1000,
        keep_s0: 1.0,
        keep_t1: 1.0,
        keep_s2: 1.0,
        query_sample_count: 1.0,
        slots: 1,
        width: 4000,
        crop_width: 4000,
        crop_height: 8,
        seed: 5,
        ..Zeroable::zeroed()
    }
}

/// Describes what is wrong with a contribution, or returns `None`. Adds 1 to `compared` if the contribution is not 0.
fn fault(q: &PathVertex, v: &PathVertex, factor: f64, got: [f32; 4], compared: &mut usize) -> Option<String> {
    let (want, cosine) = exact(q, v);
    let want = want * factor;
    let got_light = dvec(&got[..3]);
    let finite = got.iter().all(|x| x.is_finite());
    let about = || format!("got {got:?}, expected {want} (cosine {cosine:e})\nq {q:?}\nv {v:?}");
    if !finite || got_light.min_element() < 0.0 {
        return Some(about());
    }
    if got_light == DVec3::ZERO {
        // The gate is open and nothing occludes a pair, so only rounding may hide it. Values below f32's range become 0.
        return (cosine > 1e-3 && want.min_element() > 1e-36).then(about);
    }
    *compared += 1;
    // A cosine has an absolute error of 3e-7. Value and weight depend on at most its sixth power.
    let error = 1e-5 + 2e-6 / cosine.abs().max(1e-30);
    let near = (got_light - want).abs().max_element() <= error * want.abs().max_element();
    (!near && cosine > 1e-5 || cosine < -1e-5).then(about)
}

/// Asserts that `wrong` is empty, and prints at most three of its lines.
fn assert_none(name: &str, wrong: &[String]) {
    let shown = wrong[..wrong.len().min(3)].join("\n");
    assert!(wrong.is_empty(), "{name}: {} wrong\n{shown}", wrong.len());
}

/// Whether `connect` may get this pair. Pairs whose positions differ only by rounding are dropped earlier
/// (`slots.wgsl: can_connect`).
fn apart(q: &PathVertex, v: &PathVertex) -> bool {
    let size = dvec(&q.position).abs().max_element();
    (dvec(&q.position) - dvec(&v.position)).length() > 0.5f64.powi(22) * size
}

#[test]
fn near_pairs_connect_as_in_f64() {
    let (points, lights): (Vec<_>, Vec<_>) = {
        let (points, lights) = pairs();
        points.into_iter().zip(lights).filter(|(q, v)| apart(q, v)).unzip()
    };
    let bench = Bench::new(parts::diffuse("grey", [BASE; 3]), false);
    let chosen: Vec<Candidate> = (0..points.len() as u32).map(|i| Candidate { vertex: i, weight: 2.5 }).collect();
    let got = bench.connect(frame(), &points, &lights, &chosen);
    let mut compared = 0;
    let wrong: Vec<String> =
        (0..points.len()).filter_map(|i| fault(&points[i], &lights[i], 2.5, got[i], &mut compared)).collect();
    eprintln!("{compared} contributions compared");
    assert_none("connect", &wrong);
    assert!(compared > points.len() / 4, "only {compared} contributions compared");
}

#[test]
fn near_pairs_pass_the_query_kernels() {
    let (points, lights) = pairs();
    let bench = Bench::new(parts::diffuse("grey", [BASE; 3]), false);
    for kernel in ["shell_query", "shell_resample"] {
        let (mut frame, mut lights) = (frame(), lights.clone());
        let chosen = bench.query(kernel, &mut frame, &points, &mut lights);
        assert!(chosen.iter().all(|c| c.weight.is_finite() && c.weight >= 0.0), "{kernel}");
        let got = bench.connect(frame, &points, &lights, &chosen);
        let (mut compared, mut near) = (0, 0);
        let mut wrong = vec![];
        for (slot, c) in chosen.iter().enumerate().filter(|(_, c)| c.vertex != NONE) {
            let (q, v) = (&points[slot / frame.slots as usize], &lights[c.vertex as usize]);
            near += usize::from((dvec(&q.position) - dvec(&v.position)).length() < 2e-3);
            wrong.extend(fault(q, v, c.weight.into(), got[slot], &mut compared));
        }
        eprintln!("{kernel}: {compared} contributions compared, {near} close pairs");
        assert_none(kernel, &wrong);
        assert!(compared > points.len() && near > 50, "{kernel}: {compared} compared, {near} close pairs");
    }
}

/// For glossy and transparent materials the test has no closed form. It only asserts finite values that are not negative.
#[test]
fn near_pairs_of_any_material_stay_finite() {
    let (points, lights) = pairs();
    for material in [
        parts::metal("metal", [0.9; 3], 0.1),
        parts::plastic("plastic", [0.5; 3], 0.03),
        Material { roughness: 0.1, ..parts::glass("rough glass") },
    ] {
        let name = material.name.clone();
        let transmits = material.transmission > 0.0;
        let of_it = |v: &PathVertex| PathVertex { flags: v.flags | if transmits { VERTEX_TRANSMITS } else { 0 }, ..*v };
        let points: Vec<PathVertex> = points.iter().map(of_it).collect();
        let bench = Bench::new(material, true);
        for kernel in ["shell_query", "shell_resample"] {
            let (mut frame, mut lights) = (frame(), lights.iter().map(of_it).collect());
            let chosen = bench.query(kernel, &mut frame, &points, &mut lights);
            let got = bench.connect(frame, &points, &lights, &chosen);
            let wrong: Vec<String> = (chosen.iter().zip(&got).enumerate())
                .filter(|(_, (c, g))| {
                    let fine = g.iter().all(|x| x.is_finite()) && g[..3].iter().all(|&x| x >= 0.0);
                    !(c.weight.is_finite() && c.weight >= 0.0 && fine)
                })
                .map(|(slot, (c, g))| {
                    format!("{c:?} {g:?} {:?} {:?}", points[slot / frame.slots as usize], lights.get(c.vertex as usize))
                })
                .collect();
            assert_none(&format!("{name}, {kernel}"), &wrong);
            let crosses = |(slot, (c, g)): (usize, (&Candidate, &[f32; 4]))| {
                let q = &points[slot / frame.slots as usize];
                let through = |v: &PathVertex| (dvec(&v.position) - dvec(&q.position)).dot(dvec(&q.geometric)) < 0.0;
                c.vertex != NONE && g[..3].iter().any(|&x| x > 0.0) && through(&lights[c.vertex as usize])
            };
            assert_eq!(chosen.iter().zip(&got).enumerate().any(crosses), transmits, "{name}, {kernel}");
        }
    }
}

/// The tests above would detect contributions that are 1 % too large, and contributions that are 0.
#[test]
fn a_wrong_contribution_is_noticed() {
    let (points, lights) = pairs();
    assert!(points.iter().zip(&lights).any(|(q, v)| !apart(q, v)));
    let bench = Bench::new(parts::diffuse("grey", [BASE; 3]), false);
    let chosen: Vec<Candidate> = (0..points.len() as u32).map(|i| Candidate { vertex: i, weight: 1.01 }).collect();
    let got = bench.connect(frame(), &points, &lights, &chosen);
    let mut compared = 0;
    let wrong = (0..points.len()).filter(|&i| fault(&points[i], &lights[i], 1.0, got[i], &mut compared).is_some());
    assert!(wrong.count() > points.len() / 8);
    let lost = (points.iter().zip(&lights)).filter(|(q, v)| fault(q, v, 1.0, [0.0; 4], &mut compared).is_some());
    assert!(lost.count() > points.len() / 4);
}

/// Both vertices are within 4e-6 m of the pinhole, and 1e-11 m apart. Squared densities would overflow to infinity there, and
/// a partial sum of 0 times infinity is not a number (`weights.wgsl: connection_weight`).
#[test]
fn densities_stay_finite_in_a_tiny_corner_near_the_pinhole() {
    let mut pcg = Pcg::new(192);
    let corner = DVec3::new(3e-6, -2e-6, 1e-6);
    let q = vertex(corner, DVec3::Z, [0.0, 0.0], &mut pcg);
    let v = vertex(corner + 1e-11 * DVec3::Z, DVec3::NEG_Z, [0.0, 0.0], &mut pcg);
    assert!(apart(&q, &v));
    let bench = Bench::new(parts::diffuse("grey", [BASE; 3]), false);
    let got = bench.connect(frame(), &[q], &[v], &[Candidate { vertex: 0, weight: 1.0 }]);
    assert!(got[0].iter().all(|x| x.is_finite()), "not finite: {:?} for {}", got[0], exact(&q, &v).0);
}
