//! The image of a sky.

use std::f64::consts::PI;

use glam::DVec3;

use super::MAX_DISTANT;

/// Radiance of the sky by direction: an equirectangular image (longitude across, latitude down) with +Y up. Each texel has one
/// radiance; nothing is interpolated. The centre of the image is +X, and -Z is at a quarter of its width, as in Blender.
#[derive(Debug, Clone, PartialEq)]
pub struct SkyImage {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// Linear RGB, row by row from the top (+Y). [`super::LightKind::Sky`] multiplies it.
    pub rgb: Vec<[f32; 3]>,
}

impl SkyImage {
    /// The image of a sky that is the same in all directions: one white texel.
    pub fn constant() -> SkyImage {
        SkyImage { width: 1, height: 1, rgb: vec![[1.0; 3]] }
    }

    /// The texel in the direction `w`, a unit vector from the scene.
    ///
    /// # Panics
    /// If the image has no texels, or if their number is not `width` times `height`.
    pub fn towards(&self, w: DVec3) -> [f32; 3] {
        let across = w.z.atan2(w.x) / (2.0 * PI) + 0.5;
        let down = w.y.clamp(-1.0, 1.0).acos() / PI;
        let index = |part: f64, size: u32| ((part * f64::from(size)) as usize).min(size as usize - 1);
        self.rgb[index(down, self.height) * self.width as usize + index(across, self.width)]
    }

    /// Solid angle of each texel in row `row`, in sr.
    pub fn solid_angle(&self, row: u32) -> f64 {
        let cosine = |row: u32| (PI * f64::from(row) / f64::from(self.height)).cos();
        2.0 * PI * (cosine(row) - cosine(row + 1)) / f64::from(self.width)
    }

    /// Integral over all directions, for red, green and blue, in sr times the unit of the texels.
    pub fn integral(&self) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (row, texels) in (0..).zip(self.rgb.chunks_exact(self.width as usize)) {
            let solid_angle = self.solid_angle(row);
            for texel in texels {
                (0..3).for_each(|k| sum[k] += solid_angle * f64::from(texel[k]));
            }
        }
        sum
    }

    /// Irradiance on a surface that faces +Y, for red, green and blue, in sr times the unit of the texels.
    pub fn irradiance_from_above(&self) -> [f64; 3] {
        let sine2 = |row: u32| (PI * f64::from(row) / f64::from(self.height)).min(0.5 * PI).sin().powi(2);
        let mut sum = [0.0; 3];
        for (row, texels) in (0..).zip(self.rgb.chunks_exact(self.width as usize)) {
            let projected = PI * (sine2(row + 1) - sine2(row)) / f64::from(self.width);
            for texel in texels {
                (0..3).for_each(|k| sum[k] += projected * f64::from(texel[k]));
            }
        }
        sum
    }

    /// Fails with one sentence if the number of texels is not width times height, or if a value is negative, not finite, or too
    /// large after it is multiplied by `strength`.
    pub(crate) fn check(&self, strength: f32) -> Result<(), String> {
        let SkyImage { width, height, rgb } = self;
        let texels = u64::from(*width) * u64::from(*height);
        if texels == 0 || texels != rgb.len() as u64 {
            return Err(format!("the sky is {width} x {height}, but has {} texels", rgb.len()));
        }
        match rgb.iter().position(|texel| !texel.iter().all(|x| x.is_finite() && *x >= 0.0)) {
            Some(i) => {
                let (row, column) = (i / *width as usize, i % *width as usize);
                Err(format!("the sky has a value that is negative or not finite at column {column}, row {row}"))
            }
            None if rgb.iter().flatten().any(|x| x * strength > MAX_DISTANT) => {
                Err(format!("the sky has a radiance above {MAX_DISTANT:e} W/(m^2 sr)"))
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_where_blender_has_them() {
        // The texel in row r and column c has the red value 8 r + c.
        let rgb = (0..32u8).map(|i| [f32::from(i), 0.0, 0.0]).collect();
        let sky = SkyImage { width: 8, height: 4, rgb };
        let at = |x: f64, y: f64, z: f64| sky.towards(DVec3::new(x, y, z).normalize())[0];
        assert_eq!(at(0.0, 1.0, 0.0), 4.0);
        assert_eq!(at(1.0, 0.1, 0.1), 12.0);
        assert_eq!(at(1.0, -0.1, -0.1), 19.0);
        assert_eq!(at(0.1, -0.1, -1.0), 18.0);
        assert_eq!(at(-0.1, -9.0, 1.0), 30.0);
        assert_eq!(at(-1.0, 0.1, 0.1), 15.0);
    }

    #[test]
    fn a_white_sky_has_the_integral_of_the_sphere() {
        let sky = SkyImage { width: 5, height: 3, rgb: vec![[1.0, 2.0, 0.0]; 15] };
        let [r, g, b] = sky.integral().map(|x| x / (4.0 * PI));
        assert!((r - 1.0).abs() < 1e-12 && (g - 2.0).abs() < 1e-12 && b == 0.0, "{r} {g} {b}");
        let [r, g, b] = sky.irradiance_from_above().map(|x| x / PI);
        assert!((r - 1.0).abs() < 1e-12 && (g - 2.0).abs() < 1e-12 && b == 0.0, "{r} {g} {b}");
    }
}
