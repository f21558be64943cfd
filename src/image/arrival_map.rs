//! A map of arrival times as a picture in colours.

/// Fraction of the lit pixels that the scale of the colours covers. Later arrivals have the last colour, so that a few late pixels do
/// not leave most of the scale unused.
const COVERED: f64 = 0.99;

/// A picture of arrival times, and its scale.
#[derive(Debug, Clone, PartialEq)]
pub struct ArrivalMap {
    /// sRGB bytes, R, G, B interleaved: from dark blue over red to yellow; black for pixels without light.
    pub bytes: Vec<u8>,
    /// Travel times with the first and the last colour, in metres: the minimum, and the time by which 99 % of the lit pixels
    /// have light.
    pub scale: [f32; 2],
    /// Maximum travel time in metres.
    pub last: f32,
    /// Number of pixels with light.
    pub lit: usize,
}

/// The map of travel times in metres, one per pixel, 0 for a pixel without light; `None` if no pixel has light.
pub fn arrival_map(arrivals: &[f32]) -> Option<ArrivalMap> {
    let mut lit: Vec<f32> = arrivals.iter().copied().filter(|&tau| tau > 0.0).collect();
    lit.sort_unstable_by(f32::total_cmp);
    let (&first, &last) = (lit.first()?, lit.last()?);
    let end = lit[((lit.len() - 1) as f64 * COVERED).ceil() as usize];
    let colour = |tau: f32| match tau > 0.0 {
        true => {
            let part = if end > first { f64::from((tau - first) / (end - first)) } else { 0.0 };
            colorous::PLASMA.eval_continuous(part.min(1.0)).into_array()
        }
        false => [0; 3],
    };
    let bytes = arrivals.iter().flat_map(|&tau| colour(tau)).collect();
    Some(ArrivalMap { bytes, scale: [first, end], last, lit: lit.len() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_run_from_the_first_light_to_that_of_almost_all_pixels() {
        // 200 lit pixels from 2 m to 3.99 m, one of them very late, and a pixel without light.
        let mut arrivals: Vec<f32> = (0..200).map(|i| 2.0 + 0.01 * i as f32).collect();
        arrivals[199] = 500.0;
        arrivals.push(0.0);
        let map = arrival_map(&arrivals).unwrap();
        assert_eq!((map.scale, map.last, map.lit), ([2.0, arrivals[198]], 500.0, 200));
        let pixel = |i: usize| &map.bytes[3 * i..3 * i + 3];
        assert_eq!((pixel(0), pixel(200)), (&[13, 8, 135][..], &[0; 3][..]));
        assert!(pixel(198) == pixel(199) && pixel(198)[0] > 200 && pixel(198)[2] < 50, "{:?}", pixel(198));
    }

    #[test]
    fn a_map_of_one_time_and_a_map_without_light() {
        assert_eq!(arrival_map(&[0.0, 0.0]), None);
        assert_eq!(arrival_map(&[4.0, 0.0, 4.0]).unwrap().bytes, [13, 8, 135, 0, 0, 0, 13, 8, 135]);
    }
}
