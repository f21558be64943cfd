//! `shared/vertex.wgsl`, `partial_sums.wgsl` and `walk.wgsl`: connections and steps of a path in world space, at vertices
//! with shading normals.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::wgsl::layout::constants::{VERTEX_BUMPED, VERTEX_TRANSMITS};
use taugate::internals::wgsl::layout::{NONE, PathState, PathVertex};

use crate::materials::set;
use crate::shader_function::{Contents, ShaderFunction, contents};
use crate::values::{direction, dvec, frame, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&CONNECT, &STEP, &SUMS];

const FRONT: u32 = 0x400;

const CONNECT: ShaderFunction = ShaderFunction {
    imports: &["vertex"],
    input: "v: PathVertex, w: vec3<f32>, pad: f32",
    result:
        "q_value: vec3<f32>, q_pdf: f32, l_value: vec3<f32>, l_pdf: f32, local: vec3<f32>, eta: f32, q_reverse: f32,
        l_reverse: f32, q_cosine: f32, l_cosine: f32",
    body: "let q = evaluate_shade_point(input.v, input.w); let l = evaluate_light_vertex(input.v, input.w);
        result.q_value = q.value; result.q_pdf = q.pdf; result.q_reverse = q.pdf_reverse; result.q_cosine = q.cosine;
        result.l_value = l.value; result.l_pdf = l.pdf; result.l_reverse = l.pdf_reverse; result.l_cosine = l.cosine;
        result.local = to_local(input.v.normal, input.w); result.eta = eta_towards(input.v, input.w);",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Input {
    v: PathVertex,
    w: [f32; 3],
    pad: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Connected {
    q_value: [f32; 3],
    q_pdf: f32,
    l_value: [f32; 3],
    l_pdf: f32,
    local: [f32; 3],
    eta: f32,
    q_reverse: f32,
    l_reverse: f32,
    q_cosine: f32,
    l_cosine: f32,
}

/// The buffers that the imported modules declare; only the materials and the albedo table have real contents.
pub fn buffers() -> Vec<Contents> {
    let mut all: Vec<Contents> = set().buffers().into();
    all.extend([contents("textures", &[0u32; 4]), contents("texels", &[0u32]), contents("emitters", &[0u32; 16])]);
    all.extend([
        contents("sky", &[0u32; 4]),
        contents("media", &[0u32; 20]),
        contents("phase_tables", &[0u32; 4]),
        contents("grids", &[0u32; 20]),
        contents("densities", &[0u32; 4]),
    ]);
    all.push(frame(|_| ()));
    all
}

/// A random vertex whose shading normal deviates by up to 0.4 rad from its geometric normal. The material is diffuse or has a
/// wide lobe (roughness above 0.4), because narrow lobes amplify the rounding of directions.
pub fn vertex(pcg: &mut Pcg) -> PathVertex {
    let set = set();
    let wide: Vec<u32> = (0..set.kinds.len() as u32).filter(|&i| set.kinds[i as usize].roughness > 0.4).collect();
    let geometric = direction(pcg);
    let normal = (geometric + 0.4 * pcg.uniform() * direction(pcg)).normalize();
    let mut to_previous = direction(pcg);
    if to_previous.dot(geometric) < 0.0 {
        to_previous = -to_previous;
    }
    let material = wide[pcg.below(wide.len())];
    let front = pcg.below(2) == 0;
    let transmits = set.kinds[material as usize].transmission > 0.0;
    PathVertex {
        normal: vec3(normal),
        geometric: vec3(geometric),
        to_previous: vec3(to_previous),
        point_words: [0; 3].map(|_| (pcg.range(0.1, 1.0) as f32).to_bits()),
        material,
        flags: if front { FRONT } else { 0 } | if transmits { VERTEX_TRANSMITS } else { 0 },
        eta: if front { 1.0 } else { set.kinds[material as usize].ior },
        select_pdf: [1.0, 0.25][pcg.below(2)],
        throughput: [1.0; 3],
        ..Zeroable::zeroed()
    }
}

#[test]
fn connections_agree_with_f64() {
    let set = set();
    let mut pcg = Pcg::new(141);
    let inputs: Vec<Input> =
        (0..30_000).map(|_| Input { v: vertex(&mut pcg), w: vec3(direction(&mut pcg)), pad: 0.0 }).collect();
    let results: Vec<Connected> = CONNECT.run(&inputs, &buffers());
    let mut compared = 0;
    for (g, r) in inputs.iter().zip(&results) {
        let v = &g.v;
        let (normal, geometric) = (dvec(&v.normal).normalize(), dvec(&v.geometric));
        let (before, w) = (dvec(&v.to_previous).normalize(), dvec(&g.w).normalize());
        // Lobes are isotropic, so any frame around the normal is right.
        let tangent = normal.any_orthonormal_vector();
        let local = |d: DVec3| DVec3::new(d.dot(tangent), d.dot(normal.cross(tangent)), d.dot(normal));
        let (known, new) = (local(before), local(w));
        let device = dvec(&r.local);
        assert!((device.z - new.z).abs() < 1e-6 && (device.length() - 1.0).abs() < 2e-6, "{g:?} {r:?}");
        let side = w.dot(geometric);
        let ior = f64::from(set.kinds[v.material as usize].ior);
        let front = v.flags & FRONT != 0;
        // At an opaque surface, both segments have the same eta.
        let through = set.kinds[v.material as usize].transmission > 0.0;
        let eta = match (through, (side >= 0.0) == front) {
            (false, _) => f64::from(v.eta),
            (true, outside) => {
                if outside {
                    1.0
                } else {
                    ior
                }
            }
        };
        assert!(side.abs() < 1e-6 || (f64::from(r.eta) - eta).abs() < 1e-6, "{g:?} {r:?}");
        assert!([r.q_cosine, r.l_cosine].iter().all(|c| (f64::from(*c) - side.abs()).abs() < 1e-6));
        // Near a horizon, rounding decides on which side of the surface a direction is.
        if [known.z, new.z, side, before.dot(geometric)].iter().any(|c| c.abs() < 0.02) {
            continue;
        }
        let reference = set.at(v.material as usize, v.point_words.map(|word| f64::from(f32::from_bits(word))));
        // No light leaks through a surface: a direction must be on the same side of both normals (Veach 1997, section 5.3).
        let open = known.z > 0.0 && side * new.z > 0.0;
        let received = before.dot(geometric).abs();
        let (toward_q, toward_w) = (reference.f(new, known, front), reference.f(known, new, front));
        let close = |got: f32, expected: f64| (f64::from(got) - expected).abs() <= 5e-3 * expected + 1e-5;
        for k in 0..3 {
            let q = if open { toward_q[k] * new.z.abs() } else { 0.0 };
            let l = if open { toward_w[k] * side.abs() * known.z / received } else { 0.0 };
            assert!(close(r.q_value[k], q) && close(r.l_value[k], l), "{g:?} {r:?} {q} {l}");
        }
        if open && toward_q[0] > 1e-4 {
            compared += 1;
            let (along, back) = (reference.pdf(known, new, front), reference.pdf(new, known, front));
            assert!(close(r.q_pdf, along) && close(r.q_reverse, back), "{g:?} {r:?} {along} {back}");
            assert!(close(r.l_pdf, along * f64::from(v.select_pdf)) && close(r.l_reverse, back), "{g:?} {r:?}");
        }
    }
    assert!(compared > 8_000, "only {compared} connections compared");
}

const STEP: ShaderFunction = ShaderFunction {
    imports: &["walk"],
    input: "v: PathVertex, u: vec4<f32>, is_sensor_subpath: u32, survival: f32, d_vcm: f32, d_vc: f32",
    result: "weight: vec3<f32>, pdf: f32, value: vec3<f32>, connect_pdf: f32, direction: vec3<f32>, valid: u32,
        state: PathState, departed: u32, connectible: u32, pad: vec2<u32>",
    body: "let s = sample_vertex(input.v, input.is_sensor_subpath == 1u, input.u);
        result.weight = s.weight; result.pdf = s.pdf; result.direction = s.direction;
        result.valid = u32(s.valid && !s.delta);
        if (s.valid) {
            var c = evaluate_light_vertex(input.v, s.direction);
            if (input.is_sensor_subpath == 1u) { c = evaluate_shade_point(input.v, s.direction); }
            result.value = c.value; result.connect_pdf = c.pdf;
        }
        var state: PathState; state.throughput = vec3<f32>(2.0); state.d_vcm = input.d_vcm; state.d_vc = input.d_vc;
        state.flags = PATH_ALIVE | PATH_DETERMINISTIC;
        result.departed = u32(scatter(&state, input.v, 1.0, input.is_sensor_subpath == 1u, input.u, input.survival));
        result.state = state; result.connectible = u32(is_connectible(input.v));",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Step {
    v: PathVertex,
    u: [f32; 4],
    is_sensor_subpath: u32,
    survival: f32,
    d_vcm: f32,
    d_vc: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Stepped {
    weight: [f32; 3],
    pdf: f32,
    value: [f32; 3],
    connect_pdf: f32,
    direction: [f32; 3],
    valid: u32,
    state: PathState,
    departed: u32,
    connectible: u32,
    pad: [u32; 2],
}

/// The weight of a sampled step is the value of a connection in the same direction over its density. Russian roulette divides
/// the throughput by the survival probability.
#[test]
fn steps_agree_with_connections() {
    let mut pcg = Pcg::new(142);
    let inputs: Vec<Step> = (0..20_000)
        .map(|i| Step {
            v: {
                let v = vertex(&mut pcg);
                // Half of the shading normals come from a normal map, so that some vertices scatter as flat surfaces.
                let bumped = if i & 2 == 0 { VERTEX_BUMPED } else { 0 };
                PathVertex { select_pdf: 1.0, flags: v.flags | bumped, ..v }
            },
            u: [0; 4].map(|_| (pcg.next_u32() >> 8) as f32 / 16_777_216.0),
            is_sensor_subpath: i & 1,
            survival: if i % 3 == 0 { -1.0 } else { pcg.uniform() as f32 },
            d_vcm: 0.5,
            d_vc: 0.25,
        })
        .collect();
    let results: Vec<Stepped> = STEP.run(&inputs, &buffers());
    let (mut compared, mut stopped, mut flat) = (0, 0, 0);
    for (g, r) in inputs.iter().zip(&results) {
        assert_eq!(r.connectible, 1);
        let cosines = |w: &[f32]| [dvec(w).dot(dvec(&g.v.normal)), dvec(w).dot(dvec(&g.v.geometric))];
        let (known, new) = (cosines(&g.v.to_previous), cosines(&r.direction));
        if r.valid == 0 || known.iter().chain(&new).any(|cosine| cosine.abs() < 0.02) || r.pdf < 1e-3 {
            continue;
        }
        compared += 1;
        let towards_sensor = if g.is_sensor_subpath == 1 { known } else { new };
        flat += usize::from(towards_sensor[0] * towards_sensor[1] < 0.0);
        for k in 0..3 {
            let expected = f64::from(r.value[k]) / f64::from(r.connect_pdf);
            assert!((f64::from(r.weight[k]) - expected).abs() < 5e-3 * expected + 1e-5, "{g:?} {r:?}");
        }
        let largest = r.weight.iter().copied().fold(0.0, f32::max);
        let keep = if g.survival < 0.0 { 1.0 } else { largest.clamp(0.05, 1.0) };
        assert_eq!(r.departed == 1, largest > 0.0 && g.survival < keep, "{g:?} {r:?}");
        if r.departed == 0 {
            stopped += 1;
            continue;
        }
        assert!((r.state.throughput[1] / (2.0 * r.weight[1] / keep) - 1.0).abs() < 1e-5, "{r:?}");
        let solid = u32::MAX << 20;
        assert_eq!(r.state.flags & !solid, 1, "the path must no longer be deterministic");
        assert_eq!(r.state.direction, r.direction);
        // Georgiev 2012, Eqs. 35 and 36, with squared densities.
        let d_vcm = 1.0 / f64::from(r.pdf).powi(2);
        assert!((f64::from(r.state.d_vcm) / d_vcm - 1.0).abs() < 1e-5);
    }
    assert!(compared > 10_000 && stopped > 500 && flat > 50, "{compared} compared, {stopped} stopped, {flat} flat");
}

#[test]
fn only_deltas_cannot_be_connected() {
    let set = set();
    let inputs: Vec<Step> = (0..set.kinds.len() as u32)
        .map(|material| Step { v: PathVertex { material, ..Zeroable::zeroed() }, ..Zeroable::zeroed() })
        .collect();
    let results: Vec<Stepped> = STEP.run(&inputs, &buffers());
    for (m, r) in set.kinds.iter().zip(&results) {
        assert_eq!(
            r.connectible == 0,
            ["mirror", "smooth glass", "twice a mirror"].contains(&m.name.as_str()),
            "{}",
            m.name
        );
    }
}

/// A thin beam stays one ray only where it meets a plain mirror. Other vertices choose among lobes or normals, and vertices with a
/// lobe that is not a delta can be connected.
#[test]
fn only_plain_mirrors_keep_a_beam_deterministic() {
    let set = set();
    let cases = [
        ("mirror", 0),
        ("mirror", VERTEX_BUMPED),
        ("retroreflecting mirror", 0),
        ("coated mirror", 0),
        ("twice a mirror", 0),
    ];
    let up = vec3(DVec3::Z);
    let at = |(name, flags): (&str, u32)| PathVertex {
        material: set.named(name, 0.0) as u32,
        flags: FRONT | flags,
        normal: up,
        geometric: up,
        to_previous: vec3(DVec3::new(0.6, 0.0, 0.8)),
        point_words: [1.0f32.to_bits(); 3],
        eta: 1.0,
        select_pdf: 1.0,
        throughput: [1.0; 3],
        ..Zeroable::zeroed()
    };
    // The value of u.w chooses the mirror under the retroreflector, or under the clear coat.
    let inputs = cases.map(|case| Step { v: at(case), u: [0.5, 0.5, 0.5, 0.4], survival: -1.0, ..Zeroable::zeroed() });
    let results: Vec<Stepped> = STEP.run(&inputs, &buffers());
    const DETERMINISTIC: u32 = 2;
    for ((name, flags), r) in cases.into_iter().zip(&results) {
        assert!(r.departed == 1 && (dvec(&r.direction) - DVec3::new(-0.6, 0.0, 0.8)).length() < 1e-6, "{name}: {r:?}");
        assert_eq!(r.state.flags & DETERMINISTIC != 0, name == "mirror" && flags == 0, "{name}, {flags}");
    }
}

const SUMS: ShaderFunction = ShaderFunction {
    imports: &["walk"],
    input: "position: vec3<f32>, eta: f32, normal: vec3<f32>, tau: f32, direction: vec3<f32>, length: f32, d_vcm: f32,
        d_vc: f32, pdf: f32, pdf_reverse: f32, cosine: f32, select_pdf: f32, delta: u32, material: u32",
    result: "left: vec2<f32>, met: vec2<f32>, tau: f32, d_vcm: f32, d_vc: f32, front: u32, normal: vec3<f32>, position: f32",
    body: "var state: PathState; state.d_vcm = input.d_vcm; state.d_vc = input.d_vc;
        var s: Scatter; s.pdf = input.pdf; s.pdf_reverse = input.pdf_reverse; s.cosine = input.cosine;
        s.delta = input.delta == 1u;
        var left: PathVertex; mis_scatter(&state, left, s, input.select_pdf);
        result.left = vec2<f32>(state.d_vcm, state.d_vc);
        mis_arrive(&state, input.length * input.length, input.cosine);
        result.met = vec2<f32>(state.d_vcm, state.d_vc);
        var path: PathState; path.position = input.position; path.direction = input.direction; path.eta = input.eta;
        path.tau = input.tau; path.d_vcm = input.d_vcm; path.d_vc = input.d_vc;
        var surface: Surface; surface.position = input.position + input.length * input.direction;
        surface.normal = input.normal; surface.geometric = input.normal; surface.material = input.material;
        find_solid(&path, surface);
        let v = arrive(&path, surface);
        result.tau = v.tau; result.d_vcm = path.d_vcm; result.d_vc = v.d_vc;
        result.front = v.flags; result.normal = v.geometric; result.position = length(path.position - v.position);",
};

#[test]
fn arriving_and_leaving_update_time_and_sums() {
    let mut pcg = Pcg::new(143);
    let inputs: Vec<[u32; 20]> = (0..5000)
        .map(|i| {
            let (p, n, d) = (direction(&mut pcg) * 10.0, direction(&mut pcg), direction(&mut pcg));
            let mut range = |lo, hi| pcg.range(lo, hi) as f32;
            let (p, n, d) = (vec3(p), vec3(n), vec3(d));
            let floats = [
                p[0],
                p[1],
                p[2],
                range(1.0, 2.0),
                n[0],
                n[1],
                n[2],
                range(0.0, 20.0),
                d[0],
                d[1],
                d[2],
                range(0.1, 9.0),
                range(0.0, 2.0),
                range(0.0, 2.0),
                range(0.1, 3.0),
                range(0.1, 3.0),
                range(0.05, 1.0),
                range(0.1, 1.0),
            ];
            let mut bits = [0; 20];
            bits[..18].copy_from_slice(&floats.map(f32::to_bits));
            bits[18] = i & 1;
            bits[19] = i % set().kinds.len() as u32;
            bits
        })
        .collect();
    assert_eq!(NONE, u32::MAX);
    let results: Vec<[u32; 12]> = SUMS.run(&inputs, &buffers());
    for (bits, r) in inputs.iter().zip(&results) {
        let g = bits.map(|b| f64::from(f32::from_bits(b)));
        let (delta, got) = (bits[18] == 1, r.map(|b| f64::from(f32::from_bits(b))));
        let (length, d_vcm, d_vc, cosine) = (g[11], g[12], g[13], g[16]);
        let density = g[14] * g[17];
        let left = if delta {
            [0.0, d_vc * (cosine / g[17]).powi(2)]
        } else {
            [density.powi(-2), (cosine / density).powi(2) * (d_vcm + d_vc * g[15].powi(2))]
        };
        let met = [left[0] * length.powi(4) / cosine.powi(2), left[1] / cosine.powi(2)];
        let facing = (0..3).map(|k| g[4 + k] * g[8 + k]).sum::<f64>();
        let on_arrival = [d_vcm * length.powi(4) / facing.powi(2), d_vc / facing.powi(2)];
        let close = |got: f64, expected: f64, tolerance: f64| (got - expected).abs() <= tolerance * expected.abs();
        assert!((0..2).all(|k| close(got[k], left[k], 1e-5) && close(got[2 + k], met[k], 1e-5)), "{g:?} {got:?}");
        // `arrive` computes the length from positions of up to 20 m, with an error of 1e-6 m; lengths are at least 0.1 m. The
        // cosine has an error of 1e-7.
        let tolerance = 1e-4 + 1e-6 / facing.abs();
        assert!(
            close(got[5], on_arrival[0], tolerance + 1e-5 / length) && close(got[6], on_arrival[1], tolerance),
            "{g:?} {got:?}"
        );
        let material = &set().kinds[bits[19] as usize];
        let transmits = material.transmission > 0.0;
        assert_eq!(r[7] & VERTEX_TRANSMITS != 0, transmits, "{g:?}");
        // At a transmitting surface, the side that the path hits determines eta of the segment.
        let eta = match (transmits, facing <= 0.0) {
            (false, _) => g[3],
            (true, true) => 1.0,
            (true, false) => material.ior.into(),
        };
        assert!((got[4] - (g[7] + eta * length)).abs() < 2e-5, "{g:?} {got:?}");
        assert_eq!(r[7] & FRONT != 0, facing <= 0.0, "{g:?}");
        let turned = (0..3).map(|k| got[8 + k] * g[8 + k]).sum::<f64>();
        assert!(turned <= 1e-7 && got[11] == 0.0);
    }
}
