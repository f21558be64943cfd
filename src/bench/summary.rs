//! Summaries of rows: medians over repetitions, ratios within repetitions, and slopes of convergence.

use super::power_law::fit_power_law;
use super::quality::{BLACK_RELMSE, Trust, trust};
use super::table::Row;
use crate::compare::metrics::Means;
use crate::settings::Estimator;

/// Median, minimum and maximum of some values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    pub median: f64,
    pub min: f64,
    pub max: f64,
}

impl Spread {
    /// `None` without values. The median of an even number of values is the geometric mean of the middle two, because errors
    /// and their ratios are compared as factors.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Spread> {
        let mut all: Vec<f64> = values.into_iter().collect();
        all.sort_by(f64::total_cmp);
        let n = all.len();
        let (low, high) = (*all.get(n.checked_sub(1)? / 2)?, all[n / 2]);
        let median = if low == high { low } else { (low * high).sqrt() };
        Some(Spread { median, min: all[0], max: all[n - 1] })
    }
}

/// The results of a variant in a scene, at the end of its time: medians over the repetitions.
#[derive(Debug, Clone)]
pub struct VariantSummary {
    pub variant: String,
    pub seconds: f64,
    pub samples: f64,
    /// relMSE over all pixels.
    pub all: ErrorSummary,
    /// relMSE without the worst pixels.
    pub trimmed: ErrorSummary,
    pub flip: Spread,
    /// Exponent of relMSE as a power of time: -1 for independent samples. Exponent of trimmed relMSE if relMSE is not
    /// fully trusted.
    /// `None` with fewer than two points.
    pub slope: Option<f64>,
    pub light_vertices: f64,
    pub queries_per_s: f64,
    pub rays_per_s: f64,
    pub dead_query_share: f64,
    /// Sum over the repetitions.
    pub dropped: u64,
    /// Microseconds per pixel sample.
    pub us_per_sample: Spread,
}

/// One error measure of a variant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorSummary {
    pub relmse: Spread,
    /// relMSE of the best baseline ([`is_baseline`]), divided by relMSE of this variant in the same repetition: above 1 if this
    /// variant is better.
    pub ratio: Option<Spread>,
    /// Whether the error of the reference makes the ratio smaller than it is.
    pub ratio_is_bound: bool,
    /// The least trust in a result of the variant.
    pub trust: Trust,
}

impl ErrorSummary {
    /// `None` without rows. The ratio is `None` if the reference is too noisy for this variant or a baseline. It is also `None` if a
    /// black image has a lower error than both in some repetition.
    fn of(rows: &[&Row], ends: &[&Row], variant: &str, part: fn(Means) -> f64) -> Option<ErrorSummary> {
        let is_baseline = |row: &&&Row| is_baseline(&row.estimator);
        let baseline = |repetition: u32| {
            let errors = ends.iter().filter(is_baseline).filter(|row| row.repetition == repetition);
            errors.map(|row| part(row.relmse)).min_by(f64::total_cmp)
        };
        let mine = || ends.iter().filter(|row| row.variant == variant);
        let of_row = |row: &&Row| trust(part(row.own), part(row.relmse));
        let trust = rows.iter().filter(|row| row.variant == variant).map(of_row).min()?;
        let both = rows.iter().filter(is_baseline).map(of_row).fold(trust, Trust::min);
        let pairs = || mine().filter_map(|row| Some((baseline(row.repetition)?, part(row.relmse))));
        let comparable = pairs().all(|(baseline, mine)| baseline.min(mine) <= BLACK_RELMSE)
            && match both {
                Trust::Full => true,
                // The same addend on both errors brings their ratio closer to 1.
                Trust::Bound => pairs().all(|(baseline, mine)| mine <= baseline),
                Trust::Nothing => false,
            };
        Some(ErrorSummary {
            relmse: Spread::of(mine().map(|row| part(row.relmse)))?,
            ratio: Spread::of(pairs().map(|(baseline, mine)| baseline / mine)).filter(|_| comparable),
            ratio_is_bound: both == Trust::Bound,
            trust,
        })
    }
}

/// Whether the estimator of this name is a baseline, with which the others are compared.
pub fn is_baseline(estimator: &str) -> bool {
    estimator.parse::<Estimator>().is_ok_and(|estimator| estimator.record().is_baseline)
}

/// relMSE over all pixels.
pub fn all(means: Means) -> f64 {
    means.all
}

/// relMSE without the worst pixels.
pub fn trimmed(means: Means) -> f64 {
    means.trimmed
}

/// A point of a convergence curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    pub seconds: f64,
    pub relmse: Spread,
}

/// Summaries of all variants in a scene, in the order of the rows.
pub fn summarise(rows: &[Row], scene: &str) -> Vec<VariantSummary> {
    let rows: Vec<&Row> = rows.iter().filter(|row| row.scene == scene).collect();
    let mut names: Vec<&str> = vec![];
    for row in &rows {
        if !names.contains(&row.variant.as_str()) {
            names.push(&row.variant);
        }
    }
    let ends: Vec<&Row> = rows.iter().copied().filter(|row| is_last(row, &rows)).collect();
    names.into_iter().filter_map(|name| summarise_variant(name, &rows, &ends)).collect()
}

/// The rows at the end of a variant's time in a scene, one per repetition.
pub fn ends<'a>(rows: &'a [Row], scene: &str, variant: &str) -> Vec<&'a Row> {
    let mine: Vec<&Row> = rows.iter().filter(|row| row.scene == scene && row.variant == variant).collect();
    mine.iter().copied().filter(|row| is_last(row, &mine)).collect()
}

fn is_last(row: &Row, rows: &[&Row]) -> bool {
    let same = |other: &&&Row| other.variant == row.variant && other.repetition == row.repetition;
    rows.iter().filter(same).all(|other| other.point <= row.point)
}

fn summarise_variant(variant: &str, rows: &[&Row], ends: &[&Row]) -> Option<VariantSummary> {
    let mine: Vec<&Row> = ends.iter().copied().filter(|row| row.variant == variant).collect();
    let median = |of: &dyn Fn(&Row) -> f64| Spread::of(mine.iter().map(|row| of(row))).map(|spread| spread.median);
    let [all_pixels, trimmed_pixels] = [all, trimmed].map(|part| ErrorSummary::of(rows, ends, variant, part));
    let (all_pixels, trimmed_pixels) = (all_pixels?, trimmed_pixels?);
    Some(VariantSummary {
        variant: variant.into(),
        seconds: median(&|row| row.seconds)?,
        samples: median(&|row| row.samples as f64)?,
        all: all_pixels,
        trimmed: trimmed_pixels,
        flip: Spread::of(mine.iter().map(|row| row.flip))?,
        slope: slope(&curve(rows, variant, if all_pixels.trust == Trust::Full { all } else { trimmed })),
        light_vertices: median(&|row| row.light_vertices)?,
        queries_per_s: median(&|row| row.queries_per_s)?,
        rays_per_s: median(&|row| row.rays_per_s)?,
        dead_query_share: median(&|row| row.dead_query_share)?,
        dropped: mine.iter().map(|row| row.dropped).sum(),
        us_per_sample: Spread::of(mine.iter().map(|row| row.us_per_sample))?,
    })
}

/// Error of one variant at every time point, in the order of time.
pub fn curve(rows: &[&Row], variant: &str, part: fn(Means) -> f64) -> Vec<Point> {
    let mine = || rows.iter().filter(|row| row.variant == variant);
    let last = mine().map(|row| row.point).max().unwrap_or(0);
    (0..=last)
        .filter_map(|point| {
            let here = || mine().filter(|row| row.point == point);
            let seconds = Spread::of(here().map(|row| row.seconds))?.median;
            Some(Point { seconds, relmse: Spread::of(here().map(|row| part(row.relmse)))? })
        })
        .collect()
}

/// Slope of the last five points. Earlier points have too few samples.
fn slope(curve: &[Point]) -> Option<f64> {
    let used = &curve[curve.len().saturating_sub(5)..];
    fit_power_law(used.iter().map(|p| (p.seconds, p.relmse.median))).map(|law| law.exponent)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::bench) fn row(variant: &str, estimator: &str, repetition: u32, point: u32, relmse: f64) -> Row {
        Row {
            scene: "s".into(),
            variant: variant.into(),
            estimator: estimator.into(),
            repetition,
            point,
            seconds: f64::from(1u32 << point),
            samples: 4,
            relmse: Means { all: relmse, trimmed: 0.5 * relmse },
            own: Means { all: 1e-3, trimmed: 1e-6 },
            flip: 0.1,
            dropped: 1,
            light_vertices: 10.0,
            queries_per_s: 1e6,
            rays_per_s: 1e6,
            dead_query_share: 0.5,
            triangles: 36,
            pixels: 100,
            gate_m: 0.5,
            optical_thickness: 0.0,
            us_per_sample: 1.0,
            fingerprint: "f".into(),
        }
    }

    #[test]
    fn spreads() {
        assert_eq!(Spread::of([]), None);
        assert_eq!(Spread::of([3.0, 1.0, 2.0]), Some(Spread { median: 2.0, min: 1.0, max: 3.0 }));
        assert_eq!(Spread::of([4.0, 1.0]).unwrap().median, 2.0);
        assert_eq!(Spread::of([0.0]).unwrap().median, 0.0);
    }

    #[test]
    fn ratios_are_of_the_same_repetition_and_slopes_of_the_medians() {
        let mut rows = vec![];
        for (repetition, noise) in [(0, 1.0), (1, 4.0), (2, 2.0)] {
            for point in 0..4 {
                let error = noise / f64::from(1u32 << point);
                rows.push(row("plain", "bdpt", repetition, point, error));
                rows.push(row("path", "pt", repetition, point, 3.0 * error));
                rows.push(row("ours", "lcs-paper", repetition, point, 0.1 * error));
            }
        }
        let summaries = summarise(&rows, "s");
        assert_eq!(summaries.iter().map(|s| s.variant.as_str()).collect::<Vec<_>>(), ["plain", "path", "ours"]);
        let ratio = summaries[2].trimmed.ratio.unwrap();
        assert!((ratio.median - 10.0).abs() < 1e-12 && (ratio.max - ratio.min).abs() < 1e-12, "{ratio:?}");
        assert_eq!(summaries[0].all.ratio.unwrap().median, 1.0);
        assert!((summaries[2].slope.unwrap() + 1.0).abs() < 1e-12);
        assert_eq!((summaries[0].all.relmse.median, summaries[0].all.relmse.max, summaries[0].dropped), (0.25, 0.5, 3));
        assert_eq!(summaries[0].trimmed.relmse.median, 0.125);
        // Over all pixels the best error, 0.0125, is less than 20 times the error of the reference, 0.001.
        let of = |error: &ErrorSummary| (error.trust, error.ratio.is_some(), error.ratio_is_bound);
        let full = (Trust::Full, true, false);
        let found: Vec<_> = summaries.iter().map(|s| (of(&s.all), of(&s.trimmed))).collect();
        assert_eq!(found, [(full, full), (full, full), ((Trust::Bound, true, true), full)]);
        // Where the baseline is better, the ratio is no lower bound.
        let noisy = rows.iter().filter(|row| row.variant != "plain").cloned();
        let noisy: Vec<Row> = noisy.map(|row| Row { own: Means { all: 0.01, trimmed: 0.0 }, ..row }).collect();
        let noisy: Vec<Row> = noisy
            .into_iter()
            .map(|row| match row.variant.as_str() {
                "ours" => Row { relmse: Means { all: 20.0 * row.relmse.all, ..row.relmse }, ..row },
                _ => Row { relmse: Means { all: 0.2 * row.relmse.all, ..row.relmse }, ..row },
            })
            .collect();
        let worse = summarise(&noisy, "s");
        assert_eq!((worse[1].all.trust, worse[1].all.ratio), (Trust::Full, None));
        // No ratio is reported for errors as small as that of the reference.
        let poor = rows.iter().cloned().map(|row| Row { own: Means { all: 0.019, trimmed: 0.0 }, ..row });
        let poor = summarise(&poor.collect::<Vec<_>>(), "s");
        assert_eq!((poor[2].all.trust, poor[2].all.ratio, poor[2].trimmed.trust), (Trust::Nothing, None, Trust::Full));
        assert_eq!((poor[0].all.trust, poor[1].all.ratio), (Trust::Bound, None));
        assert!(summarise(&rows, "elsewhere").is_empty());
    }

    #[test]
    fn only_pt_and_bdpt_are_baselines() {
        let row = |estimator, relmse| row(estimator, estimator, 0, 0, relmse);
        let rows = [row("pt", 0.4), row("bdpt", 0.2), row("epc", 0.05), row("lcs", 0.1)];
        let ratios = summarise(&rows, "s").iter().map(|s| s.all.ratio.unwrap().median).collect::<Vec<_>>();
        assert_eq!(ratios, [0.5, 1.0, 4.0, 2.0]);
    }

    #[test]
    fn images_that_are_worse_than_black_have_no_ratio() {
        let ratio = |baseline: f64, mine: f64| {
            let rows = [row("bdpt", "bdpt", 0, 0, baseline), row("lcs", "lcs", 0, 0, mine)];
            summarise(&rows, "s")[1].all.ratio.map(|ratio| ratio.median)
        };
        assert_eq!((ratio(5.0, 0.5), ratio(0.5, 5.0)), (Some(10.0), Some(0.1)));
        assert_eq!((ratio(5.0, 2.0), ratio(2.0, 5.0)), (None, None));
        // One such repetition is enough.
        let rows = [(0, 0.8), (1, 1.2)].map(|(n, x)| [row("bdpt", "bdpt", n, 0, 2.0 * x), row("lcs", "lcs", n, 0, x)]);
        assert_eq!(summarise(&rows.concat(), "s")[1].all.ratio, None);
    }
}
