use super::*;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::parts::{diffuse, metal, plastic};

fn direction(cos: f64, angle: f64) -> DVec3 {
    let sin = (1.0 - cos * cos).sqrt();
    DVec3::new(sin * angle.cos(), sin * angle.sin(), cos)
}

fn roughness(alpha: f64) -> f32 {
    alpha.sqrt() as f32
}

fn some_materials() -> Vec<Material> {
    let mixed = Material { metallic: 0.4, specular: 0.7, ..plastic("", [1.0; 3], 0.5) };
    let rough = |alpha| [metal("", [1.0; 3], roughness(alpha)), plastic("", [1.0; 3], roughness(alpha))];
    let mut all: Vec<Material> = [0.05, 0.3, 1.0].into_iter().flat_map(rough).collect();
    all.extend([diffuse("", [1.0; 3]), mixed, plastic("", [1.0; 3], 0.0)]);
    let coated = |m: Material, roughness| Material { clearcoat: 0.9, clearcoat_roughness: roughness, ..m };
    all.push(coated(metal("", [1.0; 3], 0.7), 0.0));
    all.push(coated(metal("", [1.0; 3], 0.3), 0.6));
    all.push(coated(plastic("", [1.0; 3], 0.8), 0.3));
    all.push(Material { specular_color: [30.0, 5.0, 0.0], ..plastic("", [1.0; 3], 0.5) });
    let sheet = Some(taugate::Retroreflector { share: 0.6, angle: 10.0 });
    all.push(Material { retroreflector: sheet, ..plastic("", [1.0; 3], 0.7) });
    all
}

#[test]
fn reciprocal() {
    let mut pcg = Pcg::new(1);
    for material in some_materials() {
        let prepared = PreparedMaterial::new(&material);
        let bsdf = prepared.at([0.9, 0.5, 0.1]);
        for _ in 0..1000 {
            let a = direction(pcg.range(0.01, 1.0), pcg.range(0.0, TAU));
            let b = direction(pcg.range(0.01, 1.0), pcg.range(0.0, TAU));
            for (x, y) in bsdf.eval(a, b).into_iter().zip(bsdf.eval(b, a)) {
                assert!(x > 0.0 && (x - y).abs() <= 1e-12 * x, "{x} {y}");
            }
        }
    }
}

/// Integral of `f` over the sphere with the midpoint rule. The cells are finer around `peak`, the direction in which the lobe
/// peaks.
fn over_sphere(peak: DVec3, f: impl Fn(DVec3) -> f64) -> f64 {
    let x = peak.any_orthonormal_vector();
    let y = peak.cross(x);
    let (steps, turns) = (1500, 200);
    let mut sum = 0.0;
    for i in 0..steps {
        // cos = 1 - 2 s^3: the Jacobian is 6 s^2.
        let s = (i as f64 + 0.5) / steps as f64;
        let cos = 1.0 - 2.0 * s * s * s;
        for j in 0..turns {
            let d = direction(cos, TAU * (j as f64 + 0.5) / turns as f64);
            sum += f(x * d.x + y * d.y + peak * d.z) * 6.0 * s * s;
        }
    }
    sum * TAU / f64::from(steps * turns)
}

#[test]
fn densities_integrate_to_one() {
    let is_rough = |m: &&Material| m.roughness > 0.0 && (m.clearcoat == 0.0 || m.clearcoat_roughness > 0.0);
    for material in some_materials().iter().filter(is_rough) {
        let prepared = PreparedMaterial::new(material);
        let bsdf = prepared.at([0.9, 0.5, 0.1]);
        for cos in [0.95, 0.5, 0.15] {
            let wo = direction(cos, 0.3);
            let mirrored = DVec3::new(-wo.x, -wo.y, wo.z);
            let sum = over_sphere(mirrored, |wi| bsdf.pdf(wi, wo));
            assert!((sum - 1.0).abs() < 2e-3, "roughness {}, cos {cos}: {sum}", material.roughness);
        }
    }
}

#[test]
fn samples_estimate_the_directional_albedo() {
    let mut pcg = Pcg::new(9);
    for material in some_materials() {
        let prepared = PreparedMaterial::new(&material);
        let bsdf = prepared.at([0.9, 0.5, 0.1]);
        let wo = direction(0.6, 0.3);
        let mirrored = DVec3::new(-wo.x, -wo.y, wo.z);
        let rough = over_sphere(mirrored, |wi| bsdf.eval(wi, wo)[1] * wi.z.max(0.0));
        let (mut sum, mut squares, n) = (0.0, 0.0, 100_000);
        for _ in 0..n {
            let u = [pcg.uniform(), pcg.uniform(), pcg.uniform()];
            let weight = bsdf.sample(wo, false, u).filter(|s| !s.delta).map_or(0.0, |s| s.weight[1]);
            sum += weight;
            squares += weight * weight;
        }
        let mean = sum / f64::from(n);
        let error = ((squares / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
        assert!((mean - rough).abs() < 4.0 * error + 1e-4, "{mean} {rough} {error}");
    }
}

#[test]
fn a_white_furnace_loses_little_and_gains_nothing() {
    for alpha in [0.0, 0.05, 0.3, 1.0] {
        let prepared = PreparedMaterial::new(&plastic("", [1.0; 3], roughness(alpha)));
        let bsdf = prepared.at([1.0; 3]);
        for cos in [1.0, 0.8, 0.5, 0.2, 0.08] {
            let wo = direction(cos, 0.0);
            let mirrored = DVec3::new(-wo.x, -wo.y, wo.z);
            let mirror = if alpha == 0.0 { bsdf.coat_fresnel(cos)[0] } else { 0.0 };
            let sum = mirror + over_sphere(mirrored, |wi| bsdf.eval(wi, wo)[0] * wi.z.max(0.0));
            assert!((0.99..=1.0 + 1e-3).contains(&sum), "alpha {alpha}, cos {cos}: {sum}");
        }
    }
}

#[test]
fn glass_by_hand() {
    assert!((fresnel_dielectric(1.0, 1.5) - 0.04).abs() < 1e-12);
    assert_eq!(fresnel_dielectric(0.0, 1.5), 1.0);
    // Total reflection beyond asin(1 / 1.5), whose cosine is 0.745.
    assert_eq!(fresnel_dielectric(0.74, 1.0 / 1.5), 1.0);
    assert!(fresnel_dielectric(0.76, 1.0 / 1.5) < 0.5);
    let prepared = PreparedMaterial::new(&taugate::internals::generate::parts::glass(""));
    let bsdf = prepared.at([1.0; 3]);
    assert!(bsdf.only_delta());
    let through = bsdf.sample(direction(0.5, 0.0), false, [0.9, 0.5, 0.5]).unwrap();
    assert!(through.refracted && through.weight == [1.0; 3] && (through.wi.length() - 1.0).abs() < 1e-12);
    // Snell's law: the sine is sin 60 degrees / 1.5.
    assert!((through.wi.x + 0.75f64.sqrt() / 1.5).abs() < 1e-12);
}
