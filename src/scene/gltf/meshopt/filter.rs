//! Filters: what happens to each element after decompression.

use super::Filter;

/// Applies a filter to elements of `stride` bytes. Elements whose result is not specified get an arbitrary value.
pub fn apply(filter: Filter, stride: usize, bytes: &mut [u8]) {
    if filter == Filter::None {
        return;
    }
    if filter == Filter::Exponential {
        for word in bytes.as_chunks_mut::<4>().0 {
            *word = exponential(i32::from_le_bytes(*word)).to_le_bytes();
        }
        return;
    }
    // Components of one or two bytes.
    let width = stride / 4;
    for element in bytes.chunks_exact_mut(stride) {
        let input = std::array::from_fn(|k| match element[k * width..][..width] {
            [low, high] => i32::from(i16::from_le_bytes([low, high])),
            _ => i32::from(element[k] as i8),
        });
        let unsigned = (1 << (8 * width)) - 1;
        let output = match filter {
            Filter::Octahedral => octahedral(input, (unsigned >> 1) as f32),
            Filter::Quaternion => quaternion(input),
            _ => color(input, unsigned),
        };
        for (bytes, value) in element.chunks_exact_mut(width).zip(output) {
            bytes.copy_from_slice(&value.to_le_bytes()[..width]);
        }
    }
}

/// 2^e m for an exponent of 8 bits and a mantissa of 24 bits.
fn exponential(input: i32) -> f32 {
    let exponent = (input >> 24).max(-126);
    let power = f32::from_bits(((exponent + 127) as u32) << 23);
    power * (input << 8 >> 8) as f32
}

/// A unit vector from its octahedral coordinates; the last component stays.
fn octahedral(input: [i32; 4], max: f32) -> [i32; 4] {
    let one = input[2] as f32;
    let [x, y] = [input[0] as f32 / one, input[1] as f32 / one];
    let z = 1.0 - x.abs() - y.abs();
    // The lower half of the octahedron is folded over its edges.
    let fold = z.min(0.0);
    let (x, y) = (x - fold.copysign(x), y - fold.copysign(y));
    let scale = max / (x * x + y * y + z * z).sqrt();
    let [x, y, z] = [x, y, z].map(|value| (value * scale).round() as i32);
    [x, y, z, input[3]]
}

/// A unit quaternion from three of its components; the last input holds the index of the fourth, and the scale.
fn quaternion(input: [i32; 4]) -> [i32; 4] {
    let scale = std::f32::consts::FRAC_1_SQRT_2 / (input[3] | 3) as f32;
    let [x, y, z] = [input[0], input[1], input[2]].map(|value| value as f32 * scale);
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    let largest = (input[3] & 3) as usize;
    let mut output = [0; 4];
    for (k, value) in [w, x, y, z].into_iter().enumerate() {
        output[(largest + k) % 4] = (value * 32767.0).round() as i32;
    }
    output
}

/// Red, green, blue and alpha from luma, chroma and an alpha whose highest bit gives the scale. `max` is the largest component.
fn color(input: [i32; 4], max: i32) -> [i32; 4] {
    let [luma, orange, green, alpha] = [input[0] & max, input[1], input[2], input[3] & max];
    let range = (1 << (32 - alpha.leading_zeros())) - 1;
    let alpha = alpha & range >> 1;
    let rgba = [luma + orange - green, luma + green, luma - orange - green, alpha << 1 | alpha & 1];
    rgba.map(|value| (value as f32 * (max as f32 / range as f32)).round() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_restore_unit_vectors_colours_and_floats() {
        assert_eq!(octahedral([0, 0, 127, 5], 127.0), [0, 0, 127, 5]);
        assert_eq!(octahedral([127, 0, 127, 0], 127.0), [127, 0, 0, 0]);
        assert_eq!(octahedral([127, 127, 127, 0], 127.0), [0, 0, -127, 0]);
        assert_eq!(quaternion([0, 0, 0, 0x7ffc | 3]), [0, 0, 0, 32767]);
        assert_eq!(exponential(3 << 24 | 5), 40.0);
        assert_eq!(exponential((-2i32) << 24 | 0x00ff_ffff), -0.25);
        // Eight bits: luma 128 without chroma is grey, alpha 0xff is opaque.
        assert_eq!(color([128, 0, 0, 255], 255), [128, 128, 128, 255]);
    }
}
