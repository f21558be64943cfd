//! Normal maps.

use glam::{DVec2, DVec3};
use taugate::Scene;

use super::geometry::Surface;
use super::texture;

/// Minimum cosine between a normal of a normal map and the geometric normal.
const MIN_COSINE: f64 = 0.1;

impl Surface {
    /// Unit shading normal of the front side, turned by the normal map, if there is one.
    pub fn bumped(&self, scene: &Scene) -> DVec3 {
        let material = &scene.materials[self.material as usize];
        let (Some(_), Some([tangent, bitangent])) = (material.normal_texture, self.tangents) else {
            return self.shading;
        };
        let texel = texture::sample_normal(scene, material.normal_texture, self.uv);
        let slope = texel.truncate() * f64::from(material.normal_scale);
        if slope == DVec2::ZERO {
            return self.shading;
        }
        let normal = self.shading;
        let x = tangent.reject_from(normal).normalize();
        let y = normal.cross(x) * normal.cross(x).dot(bitangent).signum();
        let turned = (x * slope.x + y * slope.y + normal * texel.z.max(1e-3)).normalize();
        if turned.dot(self.geometric) >= MIN_COSINE {
            return turned;
        }
        let across = turned.reject_from(self.geometric).normalize();
        self.geometric * MIN_COSINE + across * (1.0 - MIN_COSINE * MIN_COSINE).sqrt()
    }
}
