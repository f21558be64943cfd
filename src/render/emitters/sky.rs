//! The sky in the layout that the kernels read (`shaders/shared/sky.wgsl`).

use std::f64::consts::PI;

use super::luminance;
use crate::scene::SkyImage;
use crate::wgsl::layout::SkyHeader;

/// Stands for probability 1 in the cumulative distributions, which hold integers.
const ONE: f64 = (1u32 << 31) as f64;

/// The texel buffer of a sky: header, rows, texels. The radiance of the sky is `image` times `radiance`. `select_pdf`: probability
/// that a light subpath starts from the sky. `disk_pdf`: density per area of its start on the disk, in units of render space.
pub fn table(image: &SkyImage, radiance: [f32; 3], select_pdf: f32, disk_pdf: f32) -> Vec<[u32; 4]> {
    let SkyImage { width, height, rgb } = image;
    let lit: Vec<[f32; 3]> = rgb.iter().map(|texel| [0, 1, 2].map(|k| texel[k] * radiance[k])).collect();
    let rows: Vec<&[[f32; 3]]> = lit.chunks_exact(*width as usize).collect();
    let of_row = |row: u32| image.solid_angle(row) * rows[row as usize].iter().map(|c| luminance(*c)).sum::<f64>();
    let starts = cumulative((0..*height).map(of_row));

    let header = SkyHeader { width: *width, height: *height, select_pdf, disk_pdf };
    let mut table: Vec<[u32; 4]> = vec![bytemuck::cast(header)];
    for (row, ends) in (0..*height).zip(starts.windows(2)) {
        let south = 2 * row + 1 > *height;
        let from_pole = |edge: u32| {
            let edge = if south { *height - edge } else { edge };
            (0.5 * PI * f64::from(edge) / f64::from(*height)).sin().powi(2) as f32
        };
        table.push([ends[0], ends[1], from_pole(row).to_bits(), from_pole(row + 1).to_bits()]);
    }
    for row in rows {
        let starts = cumulative(row.iter().map(|c| luminance(*c)));
        let texels = row.iter().zip(&starts).map(|(c, start)| [c[0].to_bits(), c[1].to_bits(), c[2].to_bits(), *start]);
        table.extend(texels);
        table.push([0, 0, 0, starts[row.len()]]);
    }
    table
}

/// Cumulative sums of the weights: before each entry, then the total. The total is scaled to 1, in units of 2^-31. All sums are 0
/// if all weights are 0.
fn cumulative(weights: impl Iterator<Item = f64> + Clone) -> Vec<u32> {
    let total: f64 = weights.clone().sum();
    let mut sum = 0.0;
    let mut starts = vec![0];
    starts.extend(weights.map(|weight| {
        sum += weight;
        // When the sum reaches the total, the result is exactly 1, so black texels at the end have probability 0.
        if total > 0.0 { (sum / total * ONE) as u32 } else { 0 }
    }));
    starts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probabilities_are_in_proportion_to_the_light_of_the_texels() {
        let rgb = [[1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0; 3], [0.0; 3], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        let image = SkyImage { width: 2, height: 3, rgb: rgb.to_vec() };
        let table = table(&image, [2.0, 1.0, 1.0], 0.5, 0.25);
        assert_eq!(table.len(), 1 + 3 + 3 * 3);
        assert_eq!(table[0], [2, 3, 0.5f32.to_bits(), 0.25f32.to_bits()]);
        // Both polar rows have the solid angle pi, so their light is in the ratio 4 : 2.
        let third = f64::from(table[1][1]) / ONE;
        assert!((third - 2.0 / 3.0).abs() < 1e-9, "{third}");
        assert_eq!((table[1][0], table[2][0], table[2][1], table[3][1]), (0, table[1][1], table[1][1], 1 << 31));
        assert_eq!((table[4][3], table[6][3]), (0, 1 << 31));
        assert!(table[5][3].abs_diff(1 << 29) <= 1, "{}", table[5][3]);
        assert_eq!([table[7][3], table[8][3], table[9][3]], [0; 3]);
        assert_eq!([table[10][3], table[11][3], table[12][3]], [0, 0, 1 << 31]);
        assert_eq!(f32::from_bits(table[4][0]), 2.0);
        // The last row is measured from the lower pole.
        assert_eq!(f32::from_bits(table[3][3]), 0.0);
        assert!((f32::from_bits(table[3][2]) - 0.25).abs() < 1e-7);
    }
}
