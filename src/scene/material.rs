//! Materials: their fields, constructors for common kinds, and the range of each field.

use glam::DAffine3;

use super::Mesh;
use super::check::{Checked, below};
use super::medium::Medium;

/// How the alpha of the base colour determines coverage.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum AlphaMode {
    /// Covers everything; alpha is ignored.
    #[default]
    Opaque,
    /// Opaque where alpha >= cutoff, absent elsewhere.
    Mask(f32),
    /// Present with probability alpha.
    Blend,
}

/// A lobe around the direction that light comes from. Its share of the light is taken from all other lobes of the material. The
/// base colour tints the lobe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Retroreflector {
    /// Share of the light, in [0, 1].
    pub share: f32,
    /// Angle between the directions to light and sensor at which the lobe falls to half of its maximum, for a surface seen head-on.
    /// In degrees, from [`Retroreflector::MIN_ANGLE`] to [`Retroreflector::MAX_ANGLE`].
    pub angle: f32,
}

impl Retroreflector {
    /// Below this angle, the lobe would be as narrow as the lobes that count as mirrors.
    pub const MIN_ANGLE: f32 = 0.1;
    /// At this angle, the GGX alpha is 0.9; GGX describes no wider lobes.
    pub const MAX_ANGLE: f32 = 60.0;

    /// GGX alpha of the lobe. A facet that is tilted by half of `angle` deflects the light by `angle`. At this tilt, the
    /// distribution of facets is `1 / (1 + tan^2 / alpha^2)^2` = 1 / 2 of its maximum. This ignores its factor `cos^-4`, near 1.
    pub fn alpha(&self) -> f64 {
        (f64::from(self.angle).to_radians() / 2.0).tan() / (std::f64::consts::SQRT_2 - 1.0).sqrt()
    }

    fn check(&self, transmission: f32, of: &str) -> Checked {
        let Retroreflector { share, angle } = self;
        if !(0.0..=1.0).contains(share) {
            return Err(format!("the retroreflector of {of} has a share of {share}; it must be from 0 to 1"));
        }
        let (min, max) = (Retroreflector::MIN_ANGLE, Retroreflector::MAX_ANGLE);
        if !(min..=max).contains(angle) {
            return Err(format!(
                "the retroreflector of {of} has an angle of {angle} degrees; it must be from {min} to {max}"
            ));
        }
        if transmission > 0.0 {
            return Err(format!(
                "{of} has a retroreflector and a transmission of {transmission}; set the transmission to 0"
            ));
        }
        Ok(())
    }
}

/// A metallic-roughness material with the glTF extensions that taugate reads.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Name in messages.
    pub name: String,
    /// Linear RGB and alpha, each in [0, 1].
    pub base_color: [f32; 4],
    /// Index into [`Scene::textures`](super::Scene::textures); multiplied with `base_color`. sRGB.
    pub base_color_texture: Option<u32>,
    /// Metalness in [0, 1].
    pub metallic: f32,
    /// Perceptual roughness in [0, 1]; the GGX alpha is its square.
    pub roughness: f32,
    /// Index into [`Scene::textures`](super::Scene::textures). Its green channel multiplies `roughness`, its blue channel
    /// `metallic`; both are linear.
    pub surface_texture: Option<u32>,
    /// Index into [`Scene::textures`](super::Scene::textures): a normal map in the space of the tangents. Bytes of 128 are
    /// exactly 0.
    pub normal_texture: Option<u32>,
    /// Factor on the red and green channels of the normal map.
    pub normal_scale: f32,
    /// Radiance in W / (m^2 sr): emissiveFactor x emissiveStrength, >= 0.
    pub emission: [f32; 3],
    /// Index into [`Scene::textures`](super::Scene::textures); multiplied with `emission`. sRGB.
    pub emission_texture: Option<u32>,
    /// KHR_materials_specular: the strength of the dielectric coat, in [0, 1]. With `specular` 0 and `metallic` 0 the material is
    /// purely Lambertian.
    pub specular: f32,
    /// Index into [`Scene::textures`](super::Scene::textures). Its alpha channel multiplies `specular`; linear.
    pub specular_texture: Option<u32>,
    /// KHR_materials_specular: multiplies the reflectance of the dielectric coat at normal incidence, linear RGB, each >= 0. The
    /// renderer clamps the product to 1.
    pub specular_color: [f32; 3],
    /// Index into [`Scene::textures`](super::Scene::textures); multiplied with `specular_color`. sRGB.
    pub specular_color_texture: Option<u32>,
    /// Index of refraction, >= 1.
    pub ior: f32,
    /// Group index of transmissive solids, >= 1: travel time per length. `None`: `ior`. Thin glass has none of its own.
    pub group_ior: Option<f32>,
    /// KHR_materials_transmission, in [0, 1].
    pub transmission: f32,
    /// Index into [`Scene::textures`](super::Scene::textures). Its red channel multiplies `transmission`; linear.
    pub transmission_texture: Option<u32>,
    /// KHR_materials_clearcoat: the strength of a clear coat over everything else, in [0, 1].
    pub clearcoat: f32,
    /// Index into [`Scene::textures`](super::Scene::textures). Its red channel multiplies `clearcoat`; linear.
    pub clearcoat_texture: Option<u32>,
    /// Perceptual roughness of the clear coat, in [0, 1].
    pub clearcoat_roughness: f32,
    /// Index into [`Scene::textures`](super::Scene::textures). Its green channel multiplies `clearcoat_roughness`; linear.
    pub clearcoat_roughness_texture: Option<u32>,
    /// How the alpha of the base colour determines coverage.
    pub alpha_mode: AlphaMode,
    /// Whether the back reflects and emits as the front does; otherwise the back is black.
    pub double_sided: bool,
    /// A lobe that reflects a part of the light back to where it came from, as road signs and number plates do.
    pub retroreflector: Option<Retroreflector>,
    /// The medium inside closed meshes of this material, which must transmit light. Thin glass only absorbs light, along its thickness.
    pub interior: Option<Medium>,
    /// Whether surfaces that transmit light are thin glass: light passes straight on, and they bound no solid. `None`: open meshes are
    /// thin, closed ones are solid.
    pub thin: Option<bool>,
    /// Thickness of thin glass in metres, >= 0. It delays light.
    pub thickness: f32,
    /// KHR_materials_volume: thickness of thin glass in the units of the mesh, >= 0. It counts if `thickness` is 0.
    pub volume_thickness: f32,
}

impl Material {
    /// Travel time per length in solids of this material.
    pub fn group_index(&self) -> f32 {
        self.group_ior.unwrap_or(self.ior)
    }

    /// A Lambertian material, double-sided. `rgb` is the albedo.
    pub fn diffuse(name: &str, rgb: [f32; 3]) -> Material {
        Material {
            name: name.into(),
            base_color: [rgb[0], rgb[1], rgb[2], 1.0],
            base_color_texture: None,
            metallic: 0.0,
            roughness: 1.0,
            surface_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emission: [0.0; 3],
            emission_texture: None,
            specular: 0.0,
            specular_texture: None,
            specular_color: [1.0; 3],
            specular_color_texture: None,
            ior: 1.5,
            group_ior: None,
            transmission: 0.0,
            transmission_texture: None,
            clearcoat: 0.0,
            clearcoat_texture: None,
            clearcoat_roughness: 0.0,
            clearcoat_roughness_texture: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: true,
            retroreflector: None,
            interior: None,
            thin: None,
            thickness: 0.0,
            volume_thickness: 0.0,
        }
    }

    /// A GGX conductor; a mirror at roughness 0.
    pub fn metal(name: &str, rgb: [f32; 3], roughness: f32) -> Material {
        Material { metallic: 1.0, roughness, specular: 1.0, ..Material::diffuse(name, rgb) }
    }

    /// A diffuse base under a GGX coat with index of refraction 1.5.
    pub fn plastic(name: &str, rgb: [f32; 3], roughness: f32) -> Material {
        Material { roughness, specular: 1.0, ..Material::diffuse(name, rgb) }
    }

    /// A clear smooth dielectric with index of refraction 1.5.
    pub fn glass(name: &str) -> Material {
        Material { roughness: 0.0, specular: 1.0, transmission: 1.0, ..Material::diffuse(name, [1.0; 3]) }
    }

    /// A material that emits `radiance`, in W / (m^2 sr), on its front only and reflects nothing.
    pub fn emitter(name: &str, radiance: [f32; 3]) -> Material {
        Material { emission: radiance, double_sided: false, ..Material::diffuse(name, [0.0; 3]) }
    }

    /// Whether light passes through surfaces of this material. The metallic part of a material is opaque; a texture may lower the
    /// metalness.
    pub fn transmits(&self) -> bool {
        self.transmission > 0.0 && (self.metallic < 1.0 || self.surface_texture.is_some())
    }

    /// Whether `mesh`, which has this material, is thin glass: it transmits light and bounds no solid.
    pub fn is_sheet(&self, mesh: &Mesh) -> bool {
        self.transmits() && self.thin.unwrap_or_else(|| !mesh.is_closed())
    }

    /// Thickness in metres of thin glass on `mesh` that `transform` places: [`Material::thickness`] if it is above 0, else
    /// [`Material::volume_thickness`] times the scale. That is the scale along the normal of a flat mesh, else the mean scale.
    pub(crate) fn thickness_in(&self, transform: &DAffine3, mesh: &Mesh) -> f32 {
        if self.thickness > 0.0 || self.volume_thickness == 0.0 {
            return self.thickness;
        }
        let matrix = transform.matrix3;
        let scale = match mesh.plane_normal() {
            Some(normal) => {
                let (across, along) = normal.any_orthonormal_pair();
                matrix.determinant().abs() / (matrix * across).cross(matrix * along).length().max(f64::MIN_POSITIVE)
            }
            None => matrix.determinant().abs().cbrt(),
        };
        (f64::from(self.volume_thickness) * scale) as f32
    }

    /// Whether `mesh`, which has this material, only bounds a medium. It then does not reflect, refract or colour light. `outside`: index
    /// of refraction outside of the mesh. Such boundaries do not count as vertices of paths.
    pub fn is_null_boundary(&self, mesh: &Mesh, outside: f32) -> bool {
        let is_clear = self.base_color[..3] == [1.0; 3] && self.base_color_texture.is_none();
        let transmits = self.transmission == 1.0 && self.transmission_texture.is_none();
        let only_transmits = transmits && self.metallic == 0.0 && self.clearcoat == 0.0;
        let is_white = || mesh.colors.iter().all(|color| color[..3] == [1.0; 3]);
        self.interior.is_some()
            && self.thin != Some(true)
            && self.ior == outside
            && is_clear
            && only_transmits
            && self.emission == [0.0; 3]
            && is_white()
    }

    /// Indices of the textures that the material uses.
    pub fn textures(&self) -> impl Iterator<Item = u32> {
        let others = [self.base_color_texture, self.emission_texture, self.normal_texture];
        others.into_iter().chain(self.factor_textures()).flatten()
    }

    /// Textures of metalness and roughness, of the dielectric coat, of the clear coat and of transmission. With such a texture,
    /// more than the base colour varies over a surface.
    pub(crate) fn factor_textures(&self) -> [Option<u32>; 6] {
        let [strength, color] = [self.specular_texture, self.specular_color_texture];
        let [coat, coat_roughness] = [self.clearcoat_texture, self.clearcoat_roughness_texture];
        [self.surface_texture, strength, color, coat, coat_roughness, self.transmission_texture]
    }

    /// Fails with one sentence if a number is out of range, or if a texture index is not below `textures`, the number of
    /// textures.
    pub(super) fn check(&self, textures: usize) -> Checked {
        let name = || format!("material '{}'", self.name);
        let units = [
            ("metallic", self.metallic),
            ("roughness", self.roughness),
            ("specular", self.specular),
            ("transmission", self.transmission),
            ("clearcoat", self.clearcoat),
            ("clearcoat_roughness", self.clearcoat_roughness),
        ];
        let colour = self.base_color.map(|x| ("base_color", x));
        if let Some((what, x)) = units.iter().chain(&colour).find(|(_, x)| !(0.0..=1.0).contains(x)) {
            return Err(format!("{} has a {what} of {x}; it must be from 0 to 1", name()));
        }
        for (what, color) in [("an emission", self.emission), ("a specular_color", self.specular_color)] {
            if let Some(x) = color.iter().find(|x| !(x.is_finite() && **x >= 0.0)) {
                return Err(format!("{} has {what} of {x}; it must be 0 or more", name()));
            }
        }
        if !self.normal_scale.is_finite() {
            return Err(format!("{} has a normal_scale of {}; it must be finite", name(), self.normal_scale));
        }
        if !(self.ior.is_finite() && self.ior >= 1.0) {
            return Err(format!("{} has an ior of {}; it must be 1 or more", name(), self.ior));
        }
        if let Some(index) = self.group_ior.filter(|index| !(index.is_finite() && *index >= 1.0)) {
            return Err(format!("{} has a group_ior of {index}; it must be 1 or more", name()));
        }
        for thickness in [self.thickness, self.volume_thickness] {
            if !(thickness.is_finite() && thickness >= 0.0) {
                return Err(format!("{} has a thickness of {thickness}; it must be 0 or more", name()));
            }
        }
        if let Some(retroreflector) = &self.retroreflector {
            retroreflector.check(self.transmission, &name())?;
        }
        if let Some(interior) = &self.interior {
            interior.check_interior(&format!("the medium inside {}", name()))?;
            if self.transmission == 0.0 {
                return Err(format!(
                    "{} has a medium inside, but a transmission of 0; set the transmission to 1",
                    name()
                ));
            }
        }
        self.textures().try_for_each(|texture| below(texture, textures, name, "texture"))
    }
}
