//! `shared/emitter.wgsl`: choosing an emitter, sampling points and directions, emission profiles and the falloff of spots.

use std::f64::consts::{PI, TAU};

use bytemuck::Zeroable;
use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::render::material::{MATERIAL_DOUBLE_SIDED, Material};
use taugate::internals::wgsl::layout::constants::*;
use taugate::internals::wgsl::layout::{
    Emitter, InstanceNormals, NONE, PathVertex, TextureInfo, Triangle, VertexAttributes, VertexDetails,
};

use crate::shader_function::{Contents, ShaderFunction, contents};
use crate::statistics::{chi_square, level};
use crate::values::{directions, dvec, frame, polar, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&PROFILE, &CONE, &CHOICE, &START];

/// All buffers that the module `emitter` declares.
fn buffers(emitters: &[Emitter], triangles: &[Triangle], materials: &[Material]) -> Vec<Contents> {
    vec![
        frame(|f| (f.emitter_count, f.keep_s0) = (emitters.len() as u32, 1.0)),
        contents("emitters", emitters),
        contents("triangles", triangles),
        contents("materials", materials),
        contents("corners", &[0u32]),
        contents("attributes", &[VertexAttributes::zeroed()]),
        contents("details", &[VertexDetails::zeroed()]),
        contents("instances", &[InstanceNormals::zeroed()]),
        contents("textures", &[TextureInfo::zeroed()]),
        contents("texels", &[0u32]),
    ]
}

const PROFILE: ShaderFunction = ShaderFunction {
    imports: &["emitter"],
    input: "v: PathVertex, w: vec3<f32>, pad: f32",
    result: "profile: vec2<f32>, falloff: f32, pad: f32",
    body: "result.profile = emitter_profile(input.v, input.w);
        result.falloff = spot_falloff(cap_height(input.v.to_previous, input.w), bitcast<f32>(input.v.point_words.x),
            bitcast<f32>(input.v.point_words.y));",
};

/// Each profile has the light and the density of its definition. The densities integrate to 1 over the sphere.
#[test]
fn profiles_integrate_to_one() {
    const N: usize = 256;
    let axis = DVec3::new(0.48, -0.6, 0.64);
    let tangent = axis.any_orthonormal_vector();
    for (kind, outer, inner) in
        [(0, 0.0, 0.0), (1, 0.0, 0.0), (EMIT_POINT, 0.0, 0.0), (EMIT_SPOT, 0.5, 0.9), (EMIT_SPOT, -0.25, -0.25)]
    {
        let (outer, inner): (f64, f64) = (outer, inner);
        let v = PathVertex {
            material: kind,
            geometric: vec3(axis),
            to_previous: vec3(axis),
            point_words: [((1.0 - outer) as f32).to_bits(), ((1.0 - inner) as f32).to_bits(), 0],
            ..Zeroable::zeroed()
        };
        // Half of the cells in cosine are inside the cone and half are outside, so that no cell crosses its edge.
        let world = |d: DVec3| tangent * d.x + axis.cross(tangent) * d.y + axis * d.z;
        let cosine = |i: usize| {
            let x = (i as f64 + 0.5) / N as f64;
            if x < 0.5 { -1.0 + 2.0 * x * (outer + 1.0) } else { outer + (2.0 * x - 1.0) * (1.0 - outer) }
        };
        let height = |i: usize| if i < N / 2 { outer + 1.0 } else { 1.0 - outer };
        let area = |i: usize| height(i) * 2.0 / N as f64 * TAU / 64.0;
        let inputs: Vec<[u32; 32]> = (0..N * 64)
            .map(|k| {
                let w = vec3(world(polar(cosine(k / 64), TAU * (k % 64) as f64 / 64.0))).map(f32::to_bits);
                let mut input = [0; 32];
                input[..28].copy_from_slice(bytemuck::cast_slice(&[v]));
                input[28..31].copy_from_slice(&w);
                input
            })
            .collect();
        let results: Vec<[f32; 4]> = PROFILE.run(&inputs, &[]);
        let mut sum = 0.0;
        for (k, r) in results.iter().enumerate() {
            let c = cosine(k / 64);
            let falloff = ((c - outer) / (inner - outer).max(1e-20)).clamp(0.0, 1.0).powi(2);
            let inside = if c > outer { 1.0 } else { 0.0 };
            let [light, density] = match kind {
                EMIT_ONE_SIDED => [c.max(0.0), c.max(0.0) / PI],
                EMIT_TWO_SIDED => [c.abs(), c.abs() / TAU],
                EMIT_POINT => [1.0, 0.25 / PI],
                _ => [falloff, inside / (TAU * (1.0 - outer))],
            };
            assert!(
                (f64::from(r[0]) - light).abs() < 1e-5 && (f64::from(r[1]) - density).abs() < 1e-6,
                "{kind} {c} {r:?}"
            );
            assert!(kind < EMIT_SPOT || (f64::from(r[2]) - falloff).abs() < 1e-5, "{c} {r:?} {falloff}");
            sum += f64::from(r[1]) * area(k / 64);
        }
        // The densities are linear in the cosine within each half, so the midpoint rule is exact.
        assert!((sum - 1.0).abs() < 1e-4, "profile {kind}: {sum}");
    }
}

const CONE: ShaderFunction = ShaderFunction {
    imports: &["emitter"],
    input: "axis: vec3<f32>, outer: f32, u: vec2<f32>, pad: vec2<f32>",
    result: "d: vec3<f32>, pad: f32",
    body: "result.d = uniform_cone(input.axis, input.outer, input.u);",
};

#[test]
fn cones_are_filled_uniformly() {
    const N: usize = 200_000;
    let mut pcg = Pcg::new(121);
    // `outer` is 1 - cosine of the half angle, which is 0.08 degrees for the narrowest cone.
    for outer in [2.0f64, 1.0, 0.1, 1e-3, 1e-6] {
        let axis = directions(122, 1)[0];
        let a = vec3(axis);
        let inputs: Vec<[f32; 8]> = (0..N)
            .map(|_| [a[0], a[1], a[2], outer as f32, pcg.uniform() as f32, pcg.uniform() as f32, 0.0, 0.0])
            .collect();
        let results: Vec<[f32; 4]> = CONE.run(&inputs, &[]);
        let (x, mut counts) = (axis.any_orthonormal_vector(), vec![0.0; 256]);
        for r in &results {
            let d = dvec(&r[..3]);
            // The tolerance is the rounding error of axis and direction over the sine of the half angle.
            let off = 0.5 * (d.normalize() - axis).length_squared();
            assert!((d.length() - 1.0).abs() < 2e-6 && off < outer * (1.0 + 1e-6 / outer.sqrt()));
            let height = (off / outer * 16.0).clamp(0.0, 15.99) as usize;
            let turn = (0.5 + d.dot(axis.cross(x)).atan2(d.dot(x)) / TAU) * 16.0;
            counts[height * 16 + (turn as usize).min(15)] += 1.0;
        }
        let p = chi_square(&counts, &[N as f64 / 256.0; 256]);
        assert!(p > level(4), "1 - cosine {outer}: {p:e}");
        // A density that is 3 % too large in one half and 3 % too small in the other must fail.
        let wrong: Vec<f64> = (0..256).map(|i| N as f64 / 256.0 * if i < 128 { 1.03 } else { 0.97 }).collect();
        assert!(chi_square(&counts, &wrong) < level(4));
    }
}

const CHOICE: ShaderFunction = ShaderFunction {
    imports: &["emitter"],
    input: "words: vec4<u32>",
    result: "number: u32",
    body: "result.number = choose_emitter(input.words);",
};

#[test]
fn the_alias_table_is_read_as_it_is_meant() {
    const N: usize = 1 << 16;
    let entry = |keep, other| Emitter { keep, other, ..Zeroable::zeroed() };
    let table = [entry(0.5, 1), entry(1.0, 1), entry(0.25, 4), entry(0.0, 0), entry(0.75, 3)];
    let mut expected = [0.0; 5];
    for (i, e) in table.iter().enumerate() {
        expected[i] += f64::from(e.keep) / 5.0;
        expected[e.other as usize] += f64::from(1.0 - e.keep) / 5.0;
    }
    let word = |x: f64| (x * 4_294_967_296.0) as u32;
    // A two-dimensional lattice (golden ratio).
    let inputs: Vec<[u32; 4]> = (0..N)
        .map(|i| [word(i as f64 / N as f64), word((i as f64 * 0.618_033_988_749_895).fract()), 0, 0])
        .chain([[u32::MAX; 4]])
        .collect();
    let buffers = [contents("emitters", &table), frame(|f| f.emitter_count = 5)];
    let results: Vec<u32> = CHOICE.run(&inputs, &buffers);
    for (i, p) in expected.iter().enumerate() {
        let share = results.iter().filter(|&&r| r == i as u32).count() as f64 / N as f64;
        assert!((share - p).abs() < 1e-3, "emitter {i}: chosen with probability {share}, {p} expected");
    }
}

/// A past bug: one random number chose both the entry of the alias table and whether to keep it. With 131,072 entries the
/// second choice had only 128 values, and an entry with `keep` = 0.001 was kept eight times too often.
#[test]
fn coins_are_as_fine_among_many_emitters() {
    const N: usize = 1 << 20;
    const ENTRIES: u32 = 1 << 17;
    let rare = |i| Emitter { keep: 1e-3, other: i + 1, ..Zeroable::zeroed() };
    let common = |i| Emitter { keep: 1.0, other: i, ..Zeroable::zeroed() };
    let table: Vec<Emitter> = (0..ENTRIES).map(|i| if i % 2 == 0 { rare(i) } else { common(i) }).collect();
    let mut pcg = Pcg::new(124);
    let inputs: Vec<[u32; 4]> = (0..N).map(|_| [0; 4].map(|_| pcg.next_u32())).collect();
    let results: Vec<u32> = CHOICE.run(&inputs, &[contents("emitters", &table), frame(|f| f.emitter_count = ENTRIES)]);
    let (found, expected) = (results.iter().filter(|&&r| r % 2 == 0).count() as f64, N as f64 * 0.5e-3);
    assert!((found - expected).abs() < 5.0 * expected.sqrt(), "{found} rare emitters, {expected} expected");
}

/// A past bug: with random numbers of 24 bits, 10 or 11 of the numbers led to each of 1.5 million entries. Entries were
/// chosen up to 6 % too rarely or 4 % too often.
#[test]
fn a_million_emitters_are_chosen_uniformly() {
    const ENTRIES: u32 = (3 << 19) + 7;
    let table: Vec<Emitter> = (0..ENTRIES).map(|i| Emitter { keep: 1.0, other: i, ..Zeroable::zeroed() }).collect();
    let mut pcg = Pcg::new(125);
    let entries: Vec<u32> = (0..2000).map(|_| 1 + pcg.below(ENTRIES as usize - 1) as u32).collect();
    // Two words have 2^64 values, of which entry i owns those from i / ENTRIES * 2^64 on. The inputs are the first value of
    // entry i and the last value of entry i - 1.
    let words = |value: u128| [(value >> 32) as u32, 0, value as u32, 0];
    let first = |i: u32| (u128::from(i) << 64).div_ceil(u128::from(ENTRIES));
    let inputs: Vec<[u32; 4]> = entries.iter().flat_map(|&i| [words(first(i)), words(first(i) - 1)]).collect();
    let results: Vec<u32> = CHOICE.run(&inputs, &[contents("emitters", &table), frame(|f| f.emitter_count = ENTRIES)]);
    let expected: Vec<u32> = entries.iter().flat_map(|&i| [i, i - 1]).collect();
    let wrong = results.iter().zip(&expected).filter(|(got, expected)| got != expected).count();
    assert_eq!(wrong, 0, "wrong entries of {}", results.len());
}

const START: ShaderFunction = ShaderFunction {
    imports: &["emitter"],
    input: "a: vec4<f32>, choice: f32, pad: vec3<f32>",
    result: "position: vec3<f32>, pdf: f32, direction: vec3<f32>, density: f32, throughput: vec3<f32>, phi: f32,
        d_vcm: f32, flags: u32, kind: u32, select_pdf: f32",
    body: "let e = sample_emission(choose_emitter(vec4<u32>(bitcast<u32>(input.choice))), input.a);
        result.position = e.vertex.position; result.pdf = e.pdf_direction; result.direction = e.direction;
        result.density = e.density; result.throughput = e.throughput; result.phi = e.vertex.throughput.x;
        result.d_vcm = e.vertex.d_vcm; result.kind = e.vertex.material; result.select_pdf = e.vertex.select_pdf;
        result.flags = u32(e.beam) | (u32(e.stored) << 1u) | (u32(e.deterministic) << 2u);",
};

const BEAM: u32 = 1;
const STORED: u32 = 2;
const DETERMINISTIC: u32 = 4;

/// `n` samples of one emitter. Each is a `Result` as 16 floats; the integers `flags` and `kind` are stored as bits of floats.
fn start(emitter: Emitter, flags: u32, n: usize) -> Vec<[f32; 16]> {
    let mut pcg = Pcg::new(123);
    let triangle =
        Triangle { v0: [0.0, 0.0, 5.0], v1: [4.0, 0.0, 5.0], v2: [0.0, 2.0, 5.0], corner: NONE, ..Zeroable::zeroed() };
    let material = Material {
        emission: [2.0; 3],
        emission_density: 0.125,
        opacity: 1.0,
        flags,
        base_texture: NONE,
        emission_texture: NONE,
        ..Zeroable::zeroed()
    };
    let emitter = Emitter { keep: 1.0, ..emitter };
    let inputs: Vec<[f32; 12]> = (0..n)
        .map(|_| {
            let mut input = [0.0; 12];
            input[..5].fill_with(|| (pcg.next_u32() >> 8) as f32 / 16_777_216.0);
            input
        })
        .collect();
    START.compile(&[("HAS_ALPHA", 0.0)]).run(&inputs, &buffers(&[emitter], &[triangle], &[material]))
}

#[test]
fn surfaces_emit_from_uniform_points() {
    const N: usize = 50_000;
    for flags in [0, MATERIAL_DOUBLE_SIDED] {
        let sides = if flags == 0 { 1.0 } else { 2.0 };
        let samples = start(Emitter { kind: EMITTER_TRIANGLE, select_pdf: 0.5, ..Zeroable::zeroed() }, flags, N);
        let mut counts = [0.0; 8];
        for s in &samples {
            let (p, d) = (dvec(&s[..3]), dvec(&s[4..7]));
            let (u, v) = (p.x / 4.0, p.y / 2.0);
            assert!((p.z - 5.0).abs() < 1e-6 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 + 1e-6);
            // Eight cells: the midpoints of the edges divide the triangle into four parts, each with two sides.
            let part = if u > 0.5 {
                0
            } else if v > 0.5 {
                1
            } else if u + v < 0.5 {
                2
            } else {
                3
            };
            counts[part + if d.z > 0.0 { 0 } else { 4 }] += 1.0;
            assert!((f64::from(s[3]) * sides * PI - d.z.abs()).abs() < 1e-5, "density of the direction {s:?}");
            // The throughput is radiance * cos / (density * cos / pi), phi is radiance / density, and d_vcm is 1 / density^2.
            assert!(
                (f64::from(s[8]) - 2.0 * PI * sides / 0.125).abs() < 1e-3
                    && s[11] == 16.0
                    && s[7] == 0.125
                    && s[12] == 64.0
            );
            assert_eq!(
                (s[13].to_bits(), s[14].to_bits()),
                (STORED, if flags == 0 { EMIT_ONE_SIDED } else { EMIT_TWO_SIDED })
            );
        }
        let share = N as f64 / 4.0 / sides;
        let expected: Vec<f64> = (0..8).map(|i| if i < 4 || flags != 0 { share } else { 1e-9 }).collect();
        let p = chi_square(&counts, &expected);
        assert!(p > level(2), "{counts:?}: {p:e}");
    }
}

#[test]
fn punctual_lights_and_beams_carry_their_power() {
    const N: usize = 50_000;
    let axis = DVec3::new(0.6, 0.0, -0.8);
    let place = Emitter {
        position: [1.0, 2.0, 3.0],
        direction: vec3(axis),
        select_pdf: 0.25,
        strength: [3.0; 3],
        ..Zeroable::zeroed()
    };
    let mean = |samples: &[[f32; 16]]| samples.iter().map(|s| f64::from(s[8])).sum::<f64>() / samples.len() as f64;

    let point = start(Emitter { kind: EMITTER_POINT, ..place }, 0, N);
    assert!(point.iter().all(|s| s[..3] == [1.0, 2.0, 3.0] && s[13].to_bits() == 0 && s[15] == 0.25));
    assert!(
        point
            .iter()
            .all(|s| (f64::from(s[8]) - 3.0 * 4.0 * PI / 0.25).abs() < 1e-3
                && (f64::from(s[3]) - 0.25 / PI).abs() < 1e-6)
    );
    let drift = point.iter().map(|s| dvec(&s[4..7])).sum::<DVec3>() / N as f64;
    // Each component has variance 1/3.
    assert!(drift.abs().max_element() < 4.5 * (1.0 / 3.0 / N as f64).sqrt(), "{drift}");

    // The flux of a spot is its intensity, integrated over its cone. The falloff has a mean of 1/3 between the two angles.
    let spot = start(Emitter { kind: EMITTER_SPOT, outer: 0.5, inner: 0.2, ..place }, 0, N);
    let flux = 3.0 * TAU * (0.2 + 0.3 / 3.0) / 0.25;
    // The relative standard deviation of a sample is below 1, so 4.5 standard errors are at most 0.02.
    assert!((mean(&spot) / flux - 1.0).abs() < 4.5 / (N as f64).sqrt(), "{} {flux}", mean(&spot));
    assert!(spot.iter().all(|s| dvec(&s[4..7]).dot(axis) > 0.5 - 1e-6 && (f64::from(s[3]) - 1.0 / PI).abs() < 1e-6));

    // A spot with a half angle of 0.08 degrees, whose cosine differs from 1 by only 1e-6.
    let narrow = start(Emitter { kind: EMITTER_SPOT, outer: 1e-6, inner: 4e-7, ..place }, 0, N);
    let flux = 3.0 * TAU * (4e-7 + 6e-7 / 3.0) / 0.25;
    assert!((mean(&narrow) / flux - 1.0).abs() < 4.5 / (N as f64).sqrt(), "{} {flux}", mean(&narrow));

    for radius in [0.0, 0.5] {
        let beam = start(Emitter { kind: EMITTER_BEAM, outer: radius, ..place }, 0, N);
        let wanted = BEAM | if radius == 0.0 { DETERMINISTIC } else { 0 };
        let mut within_half = 0.0;
        for s in &beam {
            let offset = dvec(&s[..3]) - DVec3::new(1.0, 2.0, 3.0);
            assert!(offset.length() <= f64::from(radius) + 1e-6 && offset.dot(axis).abs() < 1e-6);
            assert!((dvec(&s[4..7]) - axis).length() < 1e-6 && s[8] == 12.0 && s[13].to_bits() == wanted);
            within_half += f64::from(u8::from(offset.length() < 0.5 * f64::from(radius))) / N as f64;
        }
        // A disk of half the radius has a quarter of the area.
        assert!(radius == 0.0 || (within_half - 0.25).abs() < 4.5 * (0.1875 / N as f64).sqrt(), "{within_half}");
    }
}

/// The host never writes an unknown kind. If host and shaders ever disagree, the emitter must be dark, not a spot light.
#[test]
fn an_emitter_of_a_kind_without_code_sends_nothing() {
    let unknown = Emitter { kind: 1000, select_pdf: 1.0, strength: [1.0; 3], outer: 0.5, ..Zeroable::zeroed() };
    let samples = start(unknown, 0, 64);
    assert!(samples.iter().all(|s| s[8..11] == [0.0; 3] && s[13].to_bits() == 0));
    let v = PathVertex { material: 1000, point_words: [1.0f32.to_bits(), 0.5f32.to_bits(), 0], ..Zeroable::zeroed() };
    let mut input = [0u32; 32];
    input[..28].copy_from_slice(bytemuck::cast_slice(&[v]));
    input[30] = 1f32.to_bits();
    let profiles: Vec<[f32; 4]> = PROFILE.run(&[input], &[]);
    assert_eq!(profiles[0][..2], [0.0; 2]);
}
