//! Colour spaces of FLIP: linear sRGB, the opponent space YCxCz for filtering, and Hunt-adjusted L*a*b* for distances.

/// Three channels in one of these spaces.
pub type Pixel = [f32; 3];

/// Linear sRGB to CIE XYZ for D65, with the rational matrix of the published program.
const TO_XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];
/// Inverse of `TO_XYZ`.
const FROM_XYZ: [[f64; 3]; 3] = [
    [3.241_003_275, -1.537_398_934, -0.498_615_861],
    [-0.969_224_334, 1.875_930_071, 0.041_554_224],
    [0.055_639_423, -0.204_011_202, 1.057_148_933],
];
/// White in XYZ: the sums of the rows of `TO_XYZ`.
const WHITE: Pixel = [0.950_428_5, 1.0, 1.088_900_4];

fn times(matrix: &[[f64; 3]; 3], p: Pixel) -> Pixel {
    let p = p.map(f64::from);
    matrix.map(|row| (row[0] * p[0] + row[1] * p[1] + row[2] * p[2]) as f32)
}

/// The ACES fit of Narkowicz with a pre-exposure of 0.6, as in HDR-FLIP. The result is linear, 0 to 1.
pub fn tone_map(p: Pixel) -> Pixel {
    p.map(|x| {
        let x = f64::from(x.max(0.0));
        // At 1e6 the curve is white; larger values would only overflow.
        let x = x.min(1e6);
        let (above, below) = (0.36 * 2.51 * x * x + 0.6 * 0.03 * x, 0.36 * 2.43 * x * x + 0.6 * 0.59 * x + 0.14);
        (above / below).clamp(0.0, 1.0) as f32
    })
}

/// YCxCz of linear RGB: XYZ relative to white with the axes of L*a*b*, without its curve. Luminance, red-green, blue-yellow.
pub fn to_opponent(rgb: Pixel) -> Pixel {
    let xyz = times(&TO_XYZ, rgb);
    lab_axes([0, 1, 2].map(|c| xyz[c] / WHITE[c]))
}

/// Inverse of [`to_opponent`].
pub fn from_opponent([y, cx, cz]: Pixel) -> Pixel {
    let y = (y + 16.0) / 116.0;
    let relative = [y + cx / 500.0, y, y - cz / 200.0];
    times(&FROM_XYZ, [0, 1, 2].map(|c| relative[c] * WHITE[c]))
}

/// L*a*b* of linear RGB, with a* and b* scaled by luminance, because colours of dark objects matter less (Hunt effect).
pub fn hunt_lab(rgb: Pixel) -> Pixel {
    const DELTA: f32 = 6.0 / 29.0;
    let xyz = times(&TO_XYZ, rgb);
    let curve = |t: f32| match t > DELTA * DELTA * DELTA {
        true => t.cbrt(),
        false => t / (3.0 * DELTA * DELTA) + 4.0 / 29.0,
    };
    let [l, a, b] = lab_axes([0, 1, 2].map(|c| curve(xyz[c] / WHITE[c])));
    [l, 0.01 * l * a, 0.01 * l * b]
}

fn lab_axes([x, y, z]: Pixel) -> Pixel {
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// The HyAB distance, for large differences: city-block in lightness, Euclidean in a* and b*.
pub fn hyab(a: Pixel, b: Pixel) -> f32 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}
