//! `shared/receiver.wgsl`: a shade point in the form that the importance of tree nodes needs. Also the glossy lobe of
//! `shared/importance.wgsl`.

use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::wgsl::layout::constants::VERTEX_TRANSMITS;

use crate::materials::set;
use crate::scatter::{buffers, vertex};
use crate::shader_function::ShaderFunction;
use crate::values::{direction, dvec, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&GLOSS, &RECEIVER];

const GLOSS: ShaderFunction = ShaderFunction {
    imports: &["importance"],
    input: "center: vec3<f32>, radius2: f32, mirrored: vec3<f32>, spread: f32",
    result: "factor: f32",
    body: "let shell = Shell(vec3<f32>(0.0), 0.0, 1.0, 1.0, 1.0, 0.0, 0.0);
        let receiver = Receiver(shell, input.mirrored, false, input.mirrored, input.spread, 0.5);
        result.factor = gloss_factor(receiver, input.center, input.radius2);",
};

/// The factor equals its formula and integrates to pi / (1 + width / 4) over the sphere. This is less than pi, the integral of
/// the cosine of a diffuse surface, so a glossy surface counts no more light than a diffuse one.
#[test]
fn gloss_has_the_lobe_of_its_width() {
    let mut pcg = Pcg::new(11);
    for (spread, radius2) in [(0.01, 0.0), (0.2, 0.05), (1.0, 0.3), (4.0, 1.0)] {
        let width: f64 = spread + radius2;
        let axis = direction(&mut pcg);
        let input = |w: DVec3, distance: f64| {
            let [c, m] = [w * distance, axis].map(vec3);
            [c[0], c[1], c[2], radius2 as f32, m[0], m[1], m[2], spread as f32]
        };
        // One direction in each of `rings` rings of equal area around the axis.
        let rings = 20_000;
        let tangent = axis.any_orthonormal_vector();
        let towards = |i: usize| {
            let cosine = 1.0 - 2.0 * (i as f64 + 0.5) / f64::from(rings);
            axis * cosine + tangent * (1.0 - cosine * cosine).sqrt()
        };
        let inputs: Vec<[f32; 8]> = (0..rings as usize).map(|i| input(towards(i), pcg.range(0.01, 100.0))).collect();
        let results: Vec<f32> = GLOSS.run(&inputs, &[]);
        for (i, &factor) in results.iter().enumerate() {
            let chord2 = (towards(i) - axis).length_squared();
            let expected = width / (width + chord2).powi(2);
            assert!((f64::from(factor) / expected - 1.0).abs() < 1e-3, "{spread} {radius2} {i}: {factor} {expected}");
        }
        let pi = std::f64::consts::PI;
        let integral = results.iter().map(|&f| f64::from(f)).sum::<f64>() * 4.0 * pi / f64::from(rings);
        assert!((integral * (1.0 + width / 4.0) / pi - 1.0).abs() < 1e-3, "{spread} {radius2}: {integral}");
    }
}

const RECEIVER: ShaderFunction = ShaderFunction {
    imports: &["receiver"],
    input: "q: PathVertex",
    result: "mirrored: vec3<f32>, spread: f32, normal: vec3<f32>, gloss: f32, transmits: u32, lobe: f32, pad: vec2<f32>",
    body: "let r = make_receiver(input.q);
        let b = make_bsdf(input.q.material, bitcast<vec3<f32>>(input.q.point_words), (input.q.flags & VERTEX_FRONT) != 0u);
        result.mirrored = r.mirrored; result.spread = r.spread; result.normal = r.normal; result.gloss = r.gloss;
        result.transmits = u32(r.transmits);
        result.lobe = lobe_probabilities(b, dot(input.q.normal, input.q.to_previous)).gloss;",
};

/// A receiver has the mirrored direction, a lobe twice as wide as the slopes of the facets, and the probability of the glossy
/// lobe (at most 0.9). A receiver on a retroreflector has the lobe of the retroreflector.
#[test]
fn a_receiver_has_the_gloss_of_its_material() {
    let mut pcg = Pcg::new(12);
    let points: Vec<_> = (0..5000).map(|_| vertex(&mut pcg)).collect();
    let results: Vec<[f32; 12]> = RECEIVER.run(&points, &buffers());
    let (mut glossy, mut through, mut retroreflecting) = (0, 0, 0);
    for (q, r) in points.iter().zip(&results) {
        let (normal, before) = (dvec(&q.normal), dvec(&q.to_previous));
        let material = &set().kinds[q.material as usize];
        if let Some(retroreflector) = material.retroreflector {
            let spread = (4.0 * retroreflector.alpha().powi(2)).max(0.01);
            assert!(r[..3] == q.to_previous && r[7] == retroreflector.share.min(0.9), "{q:?} {r:?}");
            assert!((f64::from(r[3]) / spread - 1.0).abs() < 1e-5, "{q:?} {r:?}");
            retroreflecting += 1;
            continue;
        }
        let mirrored: DVec3 = 2.0 * normal.dot(before) * normal - before;
        assert!((dvec(&r[..3]) - mirrored).length() < 1e-5, "{q:?} {r:?}");
        let alpha = f64::from(material.roughness).powi(2);
        assert!((f64::from(r[3]) - (4.0 * alpha * alpha).max(0.01)).abs() < 1e-5, "{q:?} {r:?}");
        assert_eq!(r[4..7], q.geometric);
        assert!((r[7] - r[9].min(0.9)).abs() < 1e-5, "{q:?} {r:?}");
        assert_eq!(r[8].to_bits() == 1, q.flags & VERTEX_TRANSMITS != 0, "{q:?} {r:?}");
        glossy += usize::from(r[7] > 0.3);
        through += usize::from(r[8].to_bits() == 1);
    }
    let seen = glossy > 500 && through > 200 && retroreflecting > 200;
    assert!(seen, "{glossy} glossy receivers, {through} that transmit, {retroreflecting} that retroreflect");
}
