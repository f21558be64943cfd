//! Materials for the device, and a reference in f64 for their BSDF values and sampling densities.

use std::f64::consts::PI;
use std::sync::OnceLock;

use glam::{DAffine3, DVec3};
use taugate::internals::generate::parts;
use taugate::internals::render::albedo::AlbedoTable;
use taugate::internals::render::geometry::Geometry;
use taugate::internals::render::material::Material as DeviceMaterial;
use taugate::internals::render::space::RenderSpace;
use taugate::internals::scene::{Material, Mesh, Retroreflector, Scene};
use taugate::internals::settings::Emitters;
use taugate_oracle::bsdf::{PreparedMaterial, fresnel_dielectric};
use taugate_oracle::ggx;

use crate::shader_function::{Contents, contents};

pub const ALPHAS: [f64; 3] = [0.05, 0.3, 1.0];

fn retroreflecting(share: f32, angle: f32, m: Material) -> Material {
    Material { retroreflector: Some(Retroreflector { share, angle }), ..m }
}

/// Materials of all kinds; all are double-sided.
pub fn kinds() -> Vec<Material> {
    let rough = |alpha: f64| alpha.sqrt() as f32;
    let white = [1.0; 3];
    let mut all = vec![parts::diffuse("lambert", white)];
    all.extend(ALPHAS.map(|a| parts::metal("conductor", white, rough(a))));
    all.extend(ALPHAS.map(|a| parts::plastic("plastic", white, rough(a))));
    all.extend(ALPHAS.map(|a| Material { roughness: rough(a), ..parts::glass("rough glass") }));
    all.push(parts::metal("mirror", white, 0.0));
    all.push(parts::plastic("smooth plastic", white, 0.0));
    all.push(parts::glass("smooth glass"));
    all.push(Material { metallic: 0.4, ..parts::plastic("half metal", white, 0.5) });
    all.push(Material { specular: 0.5, ..parts::plastic("half specular", white, 0.5) });
    all.push(Material { transmission: 0.5, ior: 1.33, ..parts::plastic("half glass", white, 0.6) });
    all.push(Material { specular: 0.8, specular_color: [0.2, 2.0, 30.0], ..parts::plastic("coloured", white, 0.5) });
    let coated = |m: Material, alpha| Material { clearcoat: 0.8, clearcoat_roughness: rough(alpha), ..m };
    all.push(coated(parts::plastic("coated plastic", white, 0.5), 0.05));
    all.push(coated(parts::metal("smoothly coated metal", white, 0.5), 0.0));
    all.push(coated(parts::metal("coated mirror", white, 0.0), 0.3));
    all.push(coated(parts::metal("twice a mirror", white, 0.0), 0.0));
    all.push(coated(Material { roughness: 0.6, ..parts::glass("coated rough glass") }, 0.3));
    all.push(retroreflecting(0.5, 20.0, parts::plastic("retroreflector", white, 0.5)));
    all.push(retroreflecting(1.0, 0.2, parts::diffuse("narrow retroreflector", white)));
    all.push(retroreflecting(0.3, 8.0, parts::metal("retroreflecting mirror", white, 0.0)));
    all.push(retroreflecting(0.4, 10.0, coated(parts::plastic("coated retroreflector", white, 0.5), 0.3)));
    all.push(Material { metallic: 0.3, transmission: 0.6, ior: 1.7, ..parts::plastic("all at once", white, 0.5) });
    all
}

/// Materials as the renderer writes them for the device, and its albedo table.
pub struct Set {
    pub kinds: Vec<Material>,
    pub device: Vec<DeviceMaterial>,
    pub prepared: Vec<PreparedMaterial>,
    pub albedo: AlbedoTable,
}

pub fn set() -> &'static Set {
    static SET: OnceLock<Set> = OnceLock::new();
    SET.get_or_init(|| Set::new(kinds()))
}

impl Set {
    pub fn new(kinds: Vec<Material>) -> Set {
        let albedo = AlbedoTable::new();
        let mut scene = Scene { materials: kinds.clone(), ..Scene::default() };
        for i in 0..kinds.len() as u32 {
            let triangle = Mesh {
                positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
                triangles: vec![[0, 1, 2]],
                ..Mesh::default()
            };
            let mesh = parts::mesh(&mut scene, "triangle", i, triangle);
            parts::place(&mut scene, "node", mesh, DAffine3::IDENTITY);
        }
        let device = Geometry::new(&scene, &RenderSpace::metres(DVec3::ZERO), &Emitters::Scene, &albedo).materials;
        let prepared = kinds.iter().map(PreparedMaterial::new).collect();
        Set { kinds, device, prepared, albedo }
    }

    pub fn buffers(&self) -> [Contents; 2] {
        [contents("materials", &self.device), contents("albedo_table", &self.albedo.texels)]
    }

    /// Index of the material with this name and alpha.
    pub fn named(&self, name: &str, alpha: f64) -> usize {
        let fits = |m: &Material| m.name == name && (f64::from(m.roughness).powi(2) - alpha).abs() < 1e-3;
        self.kinds.iter().position(fits).unwrap_or_else(|| panic!("there is no material {name} with alpha {alpha}"))
    }

    /// The reference for a material where its base colour is `base`.
    pub fn at(&self, material: usize, base: [f64; 3]) -> Reference<'_> {
        let m = &self.kinds[material];
        let f0 = f64::from((m.ior - 1.0) / (m.ior + 1.0)).powi(2);
        let f0 = m.specular_color.map(|color| (f0 * f64::from(color)).min(1.0));
        // A material without a retroreflector gets one with a share of 0, whose width does not matter.
        let retroreflector = m.retroreflector.unwrap_or(Retroreflector { share: 0.0, angle: 1.0 });
        let half = (0.5 * f64::from(retroreflector.angle)).to_radians().tan();
        let share = retroreflector.share.into();
        let retro_alpha = half / 0.643_594_252_905_582_6;
        Reference {
            set: self,
            m,
            base,
            alpha: f64::from(m.roughness).powi(2),
            share,
            retro_alpha,
            f0,
            ior: m.ior.into(),
        }
    }
}

/// The BSDF of a material in f64. Directions are in the local frame, with the surface normal along +z.
#[derive(Clone, Copy)]
pub struct Reference<'a> {
    set: &'a Set,
    m: &'a Material,
    base: [f64; 3],
    pub alpha: f64,
    /// Share and GGX alpha of the retroreflector.
    share: f64,
    pub retro_alpha: f64,
    f0: [f64; 3],
    ior: f64,
}

impl Reference<'_> {
    /// Weights of metal, of coat over diffuse, and of glass.
    fn shares(&self) -> [f64; 3] {
        let (metal, glass) = (f64::from(self.m.metallic), f64::from(self.m.transmission));
        [metal, (1.0 - metal) * (1.0 - glass), (1.0 - metal) * glass]
    }

    /// Index of refraction on the side of `w`.
    pub fn index(&self, w: DVec3, front: bool) -> f64 {
        if (w.z > 0.0) == front { 1.0 } else { self.ior }
    }

    /// The direction that forms the half vector with the known direction: `d`, or at a retroreflector the mirror image of `d`.
    pub fn facing_lobe(&self, d: DVec3) -> DVec3 {
        if self.share > 0.0 { mirrored(d) } else { d }
    }

    pub fn is_delta(&self) -> bool {
        self.alpha < 1e-3
    }

    /// Directional albedo of the coat, from the renderer's table.
    pub fn coat_albedo(&self, cosine: f64) -> f64 {
        f64::from(self.m.specular) * self.set.albedo.at(cosine, self.alpha, self.brightest_f0(), 1.0)
    }

    fn brightest_f0(&self) -> f64 {
        self.f0.into_iter().fold(0.0, f64::max)
    }

    fn clearcoat_alpha(&self) -> f64 {
        f64::from(self.m.clearcoat_roughness).powi(2)
    }

    /// Directional albedo of the clear coat, from the renderer's table.
    fn clearcoat_albedo(&self, cosine: f64) -> f64 {
        f64::from(self.m.clearcoat) * self.set.albedo.at(cosine.abs(), self.clearcoat_alpha(), 0.04, 1.0)
    }

    /// The lobe of the clear coat without its Fresnel term, and the density of sampling `other` from it.
    fn clearcoat_lobe(&self, w: DVec3, other: DVec3) -> [f64; 2] {
        let alpha = self.clearcoat_alpha();
        if self.m.clearcoat == 0.0 || alpha < 1e-3 {
            return [0.0; 2];
        }
        [ggx::lobe(alpha, w, other), ggx::pdf(alpha, other, w)]
    }

    fn mean_albedo(&self) -> f64 {
        f64::from(self.m.specular) * self.set.albedo.mean(self.alpha, self.brightest_f0(), 1.0)
    }

    /// Probabilities of the diffuse, glossy and glass lobes, and of the clear coat.
    pub fn lobes(&self, cosine: f64) -> [f64; 4] {
        let luminance = |c: [f64; 3]| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
        let [metal, plastic, glass] = self.shares();
        let coat = self.coat_albedo(cosine);
        let schlick = self.base.map(|b| b + (1.0 - b) * (1.0 - cosine).powi(5));
        let lobes = [plastic * luminance(self.base) * (1.0 - coat), plastic * coat + metal * luminance(schlick), glass];
        let top = self.clearcoat_albedo(cosine);
        let [diffuse, gloss, glass] = lobes.map(|l| l * (1.0 - top));
        let sum = diffuse + gloss + glass + top;
        if sum > 0.0 { [diffuse, gloss, glass, top].map(|l| l / sum) } else { [1.0, 0.0, 0.0, 0.0] }
    }

    /// f for light that arrives from `wl` and leaves towards `wc`, per colour channel. `front`: the +z side has index 1.
    pub fn f(&self, wl: DVec3, wc: DVec3, front: bool) -> [f64; 3] {
        let others = self.f_of_others(wl, wc, front);
        let above = wl.z > 0.0 && wc.z > 0.0 && self.share > 0.0;
        let lobe = if above { ggx::lobe(self.retro_alpha, mirrored(wl), wc) } else { 0.0 };
        [0, 1, 2].map(|k| (1.0 - self.share) * others[k] + self.share * lobe * self.base[k])
    }

    /// `f` without the retroreflector.
    fn f_of_others(&self, wl: DVec3, wc: DVec3, front: bool) -> [f64; 3] {
        let [metal, plastic, glass] = self.shares();
        let above = if front { 1.0 } else { self.ior };
        let passes = (1.0 - self.clearcoat_albedo(wl.z)) * (1.0 - self.clearcoat_albedo(wc.z));
        let relative = self.ior / above / above;
        if wl.z * wc.z < 0.0 {
            let tinted = passes * glass * self.refraction(wl, wc, front).map_or(0.0, |r| r.f);
            return self.base.map(|b| b * tinted);
        }
        if wl.z <= 0.0 || wc.z <= 0.0 {
            return [0.0; 3];
        }
        let left = (1.0 - self.coat_albedo(wl.z)) * (1.0 - self.coat_albedo(wc.z)) / (PI * (1.0 - self.mean_albedo()));
        let c = wl.dot((wl + wc).normalize());
        let grazing = (1.0 - c).max(0.0).powi(5);
        let coat = self.f0.map(|f0| f64::from(self.m.specular) * (f0 + (1.0 - f0) * grazing));
        let top = f64::from(self.m.clearcoat) * (0.04 + 0.96 * grazing) * self.clearcoat_lobe(wl, wc)[0];
        let lobe = if self.is_delta() { 0.0 } else { ggx::lobe(self.alpha, wl, wc) };
        let dielectric = fresnel_dielectric(c, relative);
        [0, 1, 2].map(|k| {
            let (b, coat) = (self.base[k], coat[k]);
            let gloss = metal * (b + (1.0 - b) * grazing) + plastic * coat + glass * dielectric;
            passes * (plastic * left * b + lobe * gloss) + top
        })
    }

    /// Density of sampling `other` where `w` is known, per solid angle. If `w` is below the surface, the function turns the
    /// surface upside down.
    pub fn pdf(&self, w: DVec3, other: DVec3, front: bool) -> f64 {
        if w.z < 0.0 {
            let turn = |d: DVec3| DVec3::new(d.x, -d.y, -d.z);
            return self.pdf(turn(w), turn(other), !front);
        }
        let retro = if other.z > 0.0 { self.share * ggx::pdf(self.retro_alpha, mirrored(other), w) } else { 0.0 };
        (1.0 - self.share) * self.pdf_of_others(w, other, front) + retro
    }

    /// `pdf` without the retroreflector, for `w` above the surface.
    fn pdf_of_others(&self, w: DVec3, other: DVec3, front: bool) -> f64 {
        let [diffuse, gloss, glass, clearcoat] = self.lobes(w.z);
        if other.z < 0.0 {
            return glass * self.refraction(other, w, front).map_or(0.0, |r| r.pdf_from_c);
        }
        let relative = if front { self.ior } else { 1.0 / self.ior };
        let reflectance = fresnel_dielectric(w.dot((w + other).normalize()), relative);
        let lobe = if self.is_delta() { 0.0 } else { ggx::pdf(self.alpha, other, w) };
        diffuse * other.z / PI + (gloss + glass * reflectance) * lobe + clearcoat * self.clearcoat_lobe(w, other)[1]
    }

    /// Rough refraction in the notation of Walter et al. 2007: light arrives from `i` and leaves towards `o`.
    fn refraction(&self, i: DVec3, o: DVec3, front: bool) -> Option<Refraction> {
        if self.is_delta() {
            return None;
        }
        let (above, below) = if front { (1.0, self.ior) } else { (self.ior, 1.0) };
        let index = |w: DVec3| if w.z > 0.0 { above } else { below };
        let (eta_i, eta_o) = (index(i), index(o));
        let m = -(eta_i * i + eta_o * o);
        if m.length() < 1e-7 {
            return None;
        }
        let m = m.normalize() * m.z.signum();
        let (im, om) = (i.dot(m), o.dot(m));
        if im * i.z <= 0.0 || om * o.z <= 0.0 {
            return None;
        }
        let passed = 1.0 - fresnel_dielectric(im.abs(), eta_o / eta_i);
        let d = ggx::distribution(self.alpha, m);
        let (li, lo) = (ggx::lambda(self.alpha, i), ggx::lambda(self.alpha, o));
        let squared = (eta_i * im + eta_o * om).powi(2);
        let f = (im * om / (i.z * o.z)).abs() * eta_o * eta_o * passed * d / ((1.0 + li + lo) * squared);
        let visible = d * om.abs() / (o.z.abs() * (1.0 + lo));
        Some(Refraction { f, pdf_from_c: visible * passed * eta_i * eta_i * im.abs() / squared })
    }
}

/// The mirror image of `w` about the normal.
fn mirrored(w: DVec3) -> DVec3 {
    DVec3::new(-w.x, -w.y, w.z)
}

struct Refraction {
    f: f64,
    /// Density of sampling `i` where `o` is known, per solid angle.
    pdf_from_c: f64,
}

/// A metal lets no light through, whatever its transmission, and keeps its roughness. A texture may lower its metalness.
#[test]
fn a_metal_has_no_transmission() {
    let metal = Material { transmission: 1.0, ior: 1.0, ..parts::metal("metal", [1.0; 3], 0.5) };
    let half = Material { metallic: 0.5, ..metal.clone() };
    let device = Set::new(vec![metal, half]).device;
    assert_eq!((device[0].transmission, device[0].alpha), (0.0, 0.25));
    assert_eq!((device[1].transmission, device[1].alpha), (1.0, 0.0));
}
