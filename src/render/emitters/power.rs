//! The power of emissive triangles that `taugate info` prints. The choice of emitters uses a coarser value: the mean of the whole
//! texture, the same for all triangles of a material.

use std::f64::consts::PI;

use glam::DVec2;

use super::luminance;
use super::triangle::{EmissiveTriangle, linear};
use crate::render::geometry::Geometry;
use crate::render::material::{MATERIAL_BLEND, MATERIAL_DOUBLE_SIDED, MATERIAL_MASK, Material};
use crate::scene::{Scene, Wrap};
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{NONE, Triangle, VertexDetails};

/// About how many points of all triangles together are looked up.
const POINTS: usize = 1 << 18;

/// Computes the power of each of `count` emissive triangles.
pub struct Powers<'a> {
    scene: &'a Scene,
    geometry: &'a Geometry,
    /// Each triangle is divided into the square of this number of parts.
    divisions: usize,
}

/// Texture coordinates and alpha of the vertex colour at the corners of a triangle.
struct Corners {
    uv: [DVec2; 3],
    alpha: [f64; 3],
}

impl<'a> Powers<'a> {
    pub fn new(scene: &'a Scene, geometry: &'a Geometry, count: usize) -> Powers<'a> {
        let divisions = (POINTS / count.max(1)).isqrt().max(1);
        Powers { scene, geometry, divisions }
    }

    /// Luminance-weighted power of the triangle in render space, over both sides if it is double-sided.
    pub fn of(&self, emitter: &EmissiveTriangle) -> f64 {
        let t = &self.geometry.triangles[emitter.entry.triangle as usize];
        let m = &self.geometry.materials[(t.material & TRIANGLE_MATERIAL) as usize];
        if m.emission_texture == NONE && t.material & TRIANGLE_ALPHA == 0 {
            return emitter.flux;
        }
        let corners = self.corners(t);
        let mut sum = 0.0;
        let n = self.divisions;
        let mut add = |i: usize, j: usize, centre: f64| {
            let [u, v] = [i, j].map(|k| (k as f64 + centre) / n as f64);
            let weights = [1.0 - u - v, u, v];
            let uv = (0..3).map(|k| corners.uv[k] * weights[k]).sum();
            let alpha = (0..3).map(|k| corners.alpha[k] * weights[k]).sum::<f64>();
            sum += self.emitted(m, uv) * self.coverage(m, uv, alpha);
        };
        for i in 0..n {
            for j in 0..n - i {
                add(i, j, 1.0 / 3.0);
                if i + j + 1 < n {
                    add(i, j, 2.0 / 3.0);
                }
            }
        }
        let sides = if m.flags & MATERIAL_DOUBLE_SIDED != 0 { 2.0 } else { 1.0 };
        sides * PI * emitter.area * sum / (n * n) as f64
    }

    fn corners(&self, t: &Triangle) -> Corners {
        if t.corner == NONE {
            return Corners { uv: [DVec2::ZERO; 3], alpha: [1.0; 3] };
        }
        let vertices = [0, 1, 2].map(|k| self.geometry.corners[(t.corner + k) as usize] as usize);
        let uv = |i: usize| {
            let vertex = self.geometry.attributes[i];
            DVec2::new(vertex.u.into(), vertex.v.into())
        };
        let alpha = |vertex: &VertexDetails| f64::from(vertex.blue_alpha >> 16) / 65535.0;
        let details = &self.geometry.details;
        Corners { uv: vertices.map(uv), alpha: vertices.map(|i| details.get(i).map_or(1.0, alpha)) }
    }

    /// Luminance of the emitted radiance.
    fn emitted(&self, m: &Material, uv: DVec2) -> f64 {
        let texel = self.texel(m.emission_texture, uv);
        luminance([0, 1, 2].map(|k| m.emission[k] * linear(texel[k])))
    }

    /// Probability that the surface is there: see `coverage` in `shared/surface.wgsl`.
    fn coverage(&self, m: &Material, uv: DVec2, vertex_alpha: f64) -> f64 {
        let alpha = || f64::from(m.opacity) * vertex_alpha * f64::from(self.texel(m.base_texture, uv)[3]) / 255.0;
        match m.flags & (MATERIAL_MASK | MATERIAL_BLEND) {
            0 => 1.0,
            MATERIAL_BLEND => alpha(),
            _ => f64::from(u8::from(alpha() >= f64::from(m.alpha_cutoff))),
        }
    }

    /// The texel at texture coordinates of the mesh, without filtering; white without a texture.
    fn texel(&self, texture: u32, uv: DVec2) -> [u8; 4] {
        let Some(texture) = self.scene.textures.get(texture as usize) else { return [255; 4] };
        let image = &self.scene.images[texture.image as usize];
        let place = texture.transform.transform_point2(uv).to_array();
        let [x, y] = [(0, image.width), (1, image.height)].map(|(axis, size)| {
            let within = match texture.wrap[axis] {
                Wrap::Clamp => place[axis].clamp(0.0, 1.0),
                Wrap::Repeat => place[axis].rem_euclid(1.0),
                Wrap::Mirror => 1.0 - (place[axis].rem_euclid(2.0) - 1.0).abs(),
            };
            ((within * f64::from(size)) as usize).min(size as usize - 1)
        });
        image.rgba[y * image.width as usize + x]
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::generate::{parts, shapes};
    use crate::render::albedo::AlbedoTable;
    use crate::render::emitters::EmitterSet;
    use crate::render::solids::Solids;
    use crate::render::space::RenderSpace;
    use crate::scene::{AlphaMode, Image, Material};
    use crate::settings::Emitters;

    /// The power of a lamp of 2 m x 3 m over that of a white, opaque lamp. Its texture coordinates go from 0 to `size`. The texture has
    /// a white column with an alpha of 0.4 and a green column with an alpha of 1.
    fn share(size: [f32; 2], change: impl Fn(u32, &mut Material)) -> f64 {
        let mut scene = Scene::default();
        let rgba = vec![[255, 255, 255, 102], [0, 255, 0, 255]];
        let texture = parts::texture(&mut scene, Image { width: 2, height: 1, rgba });
        let mut lamp = parts::emitter("lamp", [1.0; 3]);
        change(texture, &mut lamp);
        let lamp = parts::material(&mut scene, lamp);
        parts::add(&mut scene, "lamp", lamp, shapes::quad(DVec3::ZERO, 2.0 * DVec3::X, 3.0 * DVec3::Y, size));
        let space = RenderSpace { origin: DVec3::ZERO, unit: 2.0 };
        let geometry = Geometry::new(&scene, &space, &Emitters::Scene, AlbedoTable::shared());
        let set = EmitterSet::new(&scene, &Emitters::Scene, &space, &geometry, &Solids::default());
        set.powers.get("lamp").map_or(0.0, |power| power / (6.0 * PI))
    }

    #[test]
    fn the_power_counts_what_the_lamp_shows_of_its_textures() {
        let close = |a: f64, b: f64| assert!((a - b).abs() < 0.004, "{a} instead of {b}");
        let textured = |texture, lamp: &mut Material| lamp.emission_texture = Some(texture);
        close(share([1.0; 2], |_, _| ()), 1.0);
        // The white half alone, both halves, three quarters of the texture.
        close(share([0.5, 1.0], textured), 1.0);
        close(share([1.0; 2], textured), 0.5 + 0.5 * 0.7152);
        close(share([0.75, 1.0], textured), (2.0 + 0.7152) / 3.0);
        let red = |texture, lamp: &mut Material| {
            lamp.emission = [1.0, 0.0, 0.0];
            lamp.emission_texture = Some(texture);
        };
        close(share([1.0; 2], red), 0.5 * 0.2126);
        let blend = |texture, lamp: &mut Material| {
            (lamp.alpha_mode, lamp.base_color_texture, lamp.base_color[3]) = (AlphaMode::Blend, Some(texture), 0.5);
        };
        close(share([1.0; 2], blend), 0.5 * 0.7);
        let mask = |texture, lamp: &mut Material| {
            (lamp.alpha_mode, lamp.base_color_texture) = (AlphaMode::Mask(0.5), Some(texture));
        };
        close(share([1.0; 2], mask), 0.5);
        close(share([0.5, 1.0], mask), 0.0);
    }
}
