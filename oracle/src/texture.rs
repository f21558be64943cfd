//! Texture look-ups with repeat, mirror or clamp, nearest or bilinear. Filtering works on linear values.

use std::sync::LazyLock;

use glam::{DVec2, DVec3};
use taugate::{Scene, Wrap};

/// Linear RGBA at a texture coordinate of the mesh. After the transform of the texture, (0, 0) is the outer corner of the first
/// texel. Without a texture, the result is white.
pub fn sample(scene: &Scene, texture: Option<u32>, uv: DVec2) -> [f64; 4] {
    filtered(scene, texture, uv, |[r, g, b, a]| {
        [srgb_to_linear(r), srgb_to_linear(g), srgb_to_linear(b), f64::from(a) / 255.0]
    })
}

/// As [`sample`], for a texture whose four channels are linear.
pub fn sample_data(scene: &Scene, texture: Option<u32>, uv: DVec2) -> [f64; 4] {
    filtered(scene, texture, uv, |texel| texel.map(|byte| f64::from(byte) / 255.0))
}

/// As [`sample`], for a normal map: x, y and z from about -1 to 1, where a byte of 128 means exactly 0. Without a
/// texture all channels are 1, which is no flat normal: test for a texture first.
pub fn sample_normal(scene: &Scene, texture: Option<u32>, uv: DVec2) -> DVec3 {
    let [x, y, z, _] = filtered(scene, texture, uv, |texel| texel.map(|byte| (f64::from(byte) - 128.0) / 127.0));
    DVec3::new(x, y, z)
}

/// Filters texels after decoding them with `decode`.
fn filtered(scene: &Scene, texture: Option<u32>, uv: DVec2, decode: impl Fn([u8; 4]) -> [f64; 4]) -> [f64; 4] {
    let Some(texture) = texture else { return [1.0; 4] };
    let texture = &scene.textures[texture as usize];
    let image = &scene.images[texture.image as usize];
    let texel = |x: i64, y: i64| {
        let x = wrap(x, i64::from(image.width), texture.wrap[0]);
        let y = wrap(y, i64::from(image.height), texture.wrap[1]);
        decode(image.rgba[(y * i64::from(image.width) + x) as usize])
    };
    let uv = texture.transform.transform_point2(uv);
    let (x, y) = (uv.x * f64::from(image.width), uv.y * f64::from(image.height));
    if !texture.linear {
        return texel(x.floor() as i64, y.floor() as i64);
    }
    // Texel centres are at half integers.
    let (x, y) = (x - 0.5, y - 0.5);
    let (column, row) = (x.floor() as i64, y.floor() as i64);
    let (fx, fy) = (x - x.floor(), y - y.floor());
    let mut sum = [0.0; 4];
    for (dx, dy, weight) in
        [(0, 0, (1.0 - fx) * (1.0 - fy)), (1, 0, fx * (1.0 - fy)), (0, 1, (1.0 - fx) * fy), (1, 1, fx * fy)]
    {
        let value = texel(column + dx, row + dy);
        (0..4).for_each(|k| sum[k] += weight * value[k]);
    }
    sum
}

/// Decodes an sRGB byte to a linear value in [0, 1].
fn srgb_to_linear(byte: u8) -> f64 {
    static VALUES: LazyLock<[f64; 256]> = LazyLock::new(|| {
        std::array::from_fn(|byte| {
            let s = byte as f64 / 255.0;
            if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
        })
    });
    VALUES[usize::from(byte)]
}

fn wrap(i: i64, size: i64, mode: Wrap) -> i64 {
    match mode {
        Wrap::Repeat => i.rem_euclid(size),
        Wrap::Clamp => i.clamp(0, size - 1),
        Wrap::Mirror => {
            let twice = i.rem_euclid(2 * size);
            twice.min(2 * size - 1 - twice)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DAffine2;
    use taugate::{Image, Texture};

    #[test]
    fn wrapping_and_filtering() {
        assert_eq!([-1, 0, 2, 3].map(|i| wrap(i, 3, Wrap::Repeat)), [2, 0, 2, 0]);
        assert_eq!([-1, 0, 2, 3].map(|i| wrap(i, 3, Wrap::Clamp)), [0, 0, 2, 2]);
        assert_eq!([-1, 0, 2, 3, 5, 6].map(|i| wrap(i, 3, Wrap::Mirror)), [0, 0, 2, 2, 0, 0]);
        let image = Image { width: 2, height: 1, rgba: vec![[0, 0, 0, 255], [255, 255, 255, 0]] };
        let texture = Texture { image: 0, wrap: [Wrap::Clamp; 2], linear: true, transform: DAffine2::IDENTITY };
        let scene = Scene { images: vec![image], textures: vec![texture], ..Scene::default() };
        assert_eq!(sample(&scene, None, DVec2::ZERO), [1.0; 4]);
        assert_eq!(sample(&scene, Some(0), DVec2::new(0.5, 0.5)), [0.5; 4]);
        assert_eq!(sample(&scene, Some(0), DVec2::new(0.25, 0.5)), [0.0, 0.0, 0.0, 1.0]);
        assert_eq!(srgb_to_linear(255), 1.0);
        assert!((srgb_to_linear(128) - 0.2158605).abs() < 1e-6);
    }
}
