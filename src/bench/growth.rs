//! How the cost of a sample grows with the quantity that a sweep varies: the exponent of a fitted power law.

use std::io::Write;
use std::path::Path;

use super::power_law::{PowerLaw, fit_power_law};
use super::suite::Suite;
use super::summary::{self, Spread};
use super::sweep::Sweep;
use super::table::Row;
use crate::error::Result;
use crate::files::write_atomically;

/// One scene of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    pub scene: String,
    /// Value of the quantity that the sweep varies: the median over the repetitions.
    pub x: f64,
    /// Microseconds per pixel sample, at the last time point of each repetition.
    pub cost: Spread,
}

/// The cost of one variant in all scenes of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct Growth {
    pub sweep: Sweep,
    pub variant: String,
    /// Sorted by x; never empty.
    pub steps: Vec<Step>,
    pub power_law: Option<PowerLaw>,
}

/// One entry for each pair of a sweep and a variant that has rows.
pub fn growth(suite: &Suite, rows: &[Row]) -> Vec<Growth> {
    let mut all = vec![];
    for sweep in Sweep::ALL {
        let scenes: Vec<&str> =
            suite.scenes.iter().filter(|s| s.sweep == Some(sweep)).map(|s| s.name.as_str()).collect();
        for variant in &suite.variants {
            let step = |scene: &&str| step(rows, scene, &variant.name, sweep);
            let mut steps: Vec<Step> = scenes.iter().filter_map(step).collect();
            steps.sort_by(|a, b| a.x.total_cmp(&b.x));
            if !steps.is_empty() {
                let power_law = fit_power_law(steps.iter().map(|step| (step.x, step.cost.median)));
                all.push(Growth { sweep, variant: variant.name.clone(), steps, power_law });
            }
        }
    }
    all
}

fn step(rows: &[Row], scene: &str, variant: &str, sweep: Sweep) -> Option<Step> {
    let ends = summary::ends(rows, scene, variant);
    let x = Spread::of(ends.iter().map(|row| sweep.of(row)))?.median;
    Some(Step { scene: scene.into(), x, cost: Spread::of(ends.iter().map(|row| row.us_per_sample))? })
}

/// Writes a CSV file with one line per sweep and variant: the first and the last x, their costs, and the exponent.
pub fn write(path: &Path, growths: &[Growth]) -> Result<()> {
    write_atomically(path, |out| {
        writeln!(out, "sweep,variant,steps,from,to,us_per_sample_from,us_per_sample_to,exponent,standard_error")?;
        for Growth { sweep, variant, steps, power_law } in growths {
            let ((first, last), number) =
                (first_and_last(steps), |x: Option<f64>| x.map_or("NaN".into(), |x| format!("{x:.4}")));
            let (exponent, error) =
                (number(power_law.map(|law| law.exponent)), number(power_law.and_then(|law| law.error)));
            writeln!(
                out,
                "{},{variant},{},{},{},{:.4},{:.4},{exponent},{error}",
                sweep.name(),
                steps.len(),
                short(first.x),
                short(last.x),
                first.cost.median,
                last.cost.median
            )?;
        }
        Ok(())
    })
}

/// Rounds to six decimals, so that rounding errors do not show.
fn short(x: f64) -> f64 {
    (x * 1e6).round() / 1e6
}

/// The steps with the smallest and the largest x.
fn first_and_last(steps: &[Step]) -> (&Step, &Step) {
    (steps.first().expect("a growth has a step"), steps.last().expect("a growth has a step"))
}

/// The section of the report about growth; empty without sweeps.
pub fn section(growths: &[Growth]) -> String {
    if growths.is_empty() {
        return String::new();
    }
    let mut text = String::from(
        "\n## Growth\n\nA power law is fitted to the microseconds per pixel sample (light paths, trees and sensor paths included) \
         against the quantity that a sweep varies, by least squares of the logarithms. Exponent 0: the cost does not depend on the \
         quantity. Exponent 1: the cost is proportional to it. The number after +- is the standard error.\n\n\
         | sweep | variant | steps | from | to | us per sample, from | to | exponent |\n|---|---|---|---|---|---|---|---|\n",
    );
    for Growth { sweep, variant, steps, power_law } in growths {
        let (first, last) = first_and_last(steps);
        let exponent = power_law.map_or("-".into(), |law| {
            let error = law.error.map_or(String::new(), |error| format!(" +- {error:.3}"));
            format!("{:.3}{error}", law.exponent)
        });
        text += &format!(
            "| {} | {variant} | {} | {} | {} | {:.3} | {:.3} | {exponent} |\n",
            sweep.name(),
            steps.len(),
            short(first.x),
            short(last.x),
            first.cost.median,
            last.cost.median
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::summary::tests::row;

    #[test]
    fn laws_by_hand() {
        let exact = fit_power_law([(1.0, 3.0), (10.0, 30.0), (100.0, 300.0)]).unwrap();
        assert!((exact.exponent - 1.0).abs() < 1e-12 && exact.error.unwrap() < 1e-7);
        // Through ln y = 0, 1, 0, 1 at ln x = 0, 1, 2, 3: slope 1 / 5, sum of squared residuals 0.8,
        // standard error sqrt(0.8 / 2 / 5).
        let e = std::f64::consts::E;
        let bent = fit_power_law([(1.0, 1.0), (e, e), (e * e, 1.0), (e.powi(3), e)]).unwrap();
        assert!((bent.exponent - 0.2).abs() < 1e-12, "{bent:?}");
        assert!((bent.error.unwrap() - 0.08f64.sqrt()).abs() < 1e-12, "{bent:?}");
        assert_eq!(fit_power_law([(2.0, 1.0), (2.0, 5.0)]), None);
        assert_eq!(fit_power_law([(0.3, 1.0), (0.1 + 0.2, 5.0), (0.3, 2.0)]), None);
        assert_eq!(fit_power_law([(1.0, 2.0)]), None);
        assert_eq!(fit_power_law([]), None);
        let two = fit_power_law([(1.0, 1.0), (f64::INFINITY, 1.0), (2.0, 4.0), (3.0, f64::NAN)]).unwrap();
        assert_eq!((two.exponent.round(), two.error), (2.0, None));
    }

    #[test]
    fn sweeps_are_fitted_per_variant() {
        let text = r#"
errors = false
[[scene]]
name = "large"
generate = { name = "cornell-box", triangles = 500 }
sweep = "triangles"
[[scene]]
name = "small"
generate = { name = "cornell-box" }
sweep = "triangles"
[[scene]]
name = "aside"
generate = { name = "cornell-box" }
[[variant]]
name = "a"
[[variant]]
name = "never rendered"
"#;
        let suite = Suite::parse(Path::new("s.toml"), text.into()).unwrap();
        let measured = |scene: &str, triangles: u64, repetition: u32, cost: f64| Row {
            scene: scene.into(),
            triangles,
            us_per_sample: cost,
            ..row("a", "lcs", repetition, 3, f64::NAN)
        };
        let early = Row { point: 0, us_per_sample: 99.0, ..measured("small", 100, 0, 99.0) };
        let rows =
            [early, measured("small", 100, 0, 2.0), measured("large", 1600, 0, 4.0), measured("aside", 7, 0, 1.0)];
        let found = growth(&suite, &rows);
        assert_eq!(found.len(), 1);
        let steps: Vec<(&str, f64, f64)> =
            found[0].steps.iter().map(|s| (s.scene.as_str(), s.x, s.cost.median)).collect();
        assert_eq!(steps, [("small", 100.0, 2.0), ("large", 1600.0, 4.0)]);
        assert!((found[0].power_law.unwrap().exponent - 0.25).abs() < 1e-12);
        let page = section(&found);
        assert!(page.contains("| triangles | a | 2 | 100 | 1600 | 2.000 | 4.000 | 0.250 |"), "{page}");
        assert_eq!(section(&[]), "");

        let folder = tempfile::tempdir().unwrap();
        write(&folder.path().join("g.csv"), &found).unwrap();
        let csv = std::fs::read_to_string(folder.path().join("g.csv")).unwrap();
        assert_eq!(csv.lines().nth(1), Some("triangles,a,2,100,1600,2.0000,4.0000,0.2500,NaN"));
    }
}
