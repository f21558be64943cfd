//! The phase function of `[medium]`: its parameters, or a table from a file.

use crate::input::rows;
use crate::scene::PhaseFunction;
use crate::settings::medium::{Alpha, DropletDiameter, MeanCosine};
use crate::settings::phase::{PARAMETERS, Phase};
use crate::settings::table::MediumTable;

/// The phase function of `table`. Fails with one sentence if a parameter is missing, or has no effect.
pub(super) fn phase(table: &MediumTable) -> Result<PhaseFunction, String> {
    let phase = table.phase.clone().unwrap_or(match (table.droplet_diameter, table.phase_g) {
        (Some(_), _) => Phase::Draine,
        (None, Some(_)) => Phase::Hg,
        (None, None) => Phase::Isotropic,
    });
    let used = phase.parameters(table.droplet_diameter.is_some());
    let mut given = table.given().into_iter().map(|setting| setting.name);
    if let Some(name) = given.find(|name| PARAMETERS.contains(name) && !used.contains(name)) {
        let only = only(used);
        return Err(format!(
            "--{name} has no effect in its phase function{only}: remove it, or choose another --phase"
        ));
    }
    let missing = |flag: &str, what: &str| format!("this phase function needs {flag}, {what}");
    let first =
        || table.phase_g.map(|MeanCosine(g)| g).ok_or(missing("--phase-g", "the mean cosine of its first lobe"));
    let second = |what: &str| table.phase_g2.map(|MeanCosine(g)| g).ok_or(missing("--phase-g2", what));
    let weight =
        || table.phase_weight.map(|share| share.0).ok_or(missing("--phase-weight", "the share of its first lobe"));
    Ok(match phase {
        Phase::Isotropic => PhaseFunction::Isotropic,
        Phase::Rayleigh => PhaseFunction::Rayleigh,
        Phase::Hg => PhaseFunction::HenyeyGreenstein { g: first()? },
        Phase::DoubleHg => PhaseFunction::DoubleHenyeyGreenstein {
            g: [first()?, second("the mean cosine of its second lobe")?],
            weight: weight()?,
        },
        Phase::Draine => match table.droplet_diameter {
            Some(DropletDiameter(diameter)) => droplets(diameter),
            None if table.phase_g.is_none() => {
                return Err("draine needs --droplet-diameter, or its four parameters --phase-g, --phase-g2, --phase-weight and \
                            --phase-alpha"
                    .into());
            }
            None => PhaseFunction::HenyeyGreensteinDraine {
                g: first()?,
                g_draine: second("the parameter g of its second lobe")?,
                weight_draine: 1.0 - weight()?,
                alpha: table
                    .phase_alpha
                    .map(|Alpha(x)| x)
                    .ok_or(missing("--phase-alpha", "the alpha of its second lobe"))?,
            },
        },
        Phase::Table(path) => {
            let rows = rows::read(&path, ["cosine", "value"], "a cosine and a value", "-1,0.05")?;
            let (cosines, values) = rows.into_iter().map(<(f64, f64)>::from).unzip();
            PhaseFunction::Table { cosines, values }
        }
    })
}

/// The rest of a sentence that says which parameters a phase function has.
fn only(used: &[&str]) -> String {
    match used {
        [] => ", which has no parameters".into(),
        [one] => format!(", which has only --{one}"),
        [some @ .., last] => format!(", which has --{} and --{last}", some.join(", --")),
    }
}

/// Phase function of water droplets with the diameter `d`, from 5 to 50 micrometres. It is a fit to Mie scattering (Jendersie and
/// d'Eon 2023, equations 4 to 7).
fn droplets(d: f64) -> PhaseFunction {
    PhaseFunction::HenyeyGreensteinDraine {
        g: (-0.0990567 / (d - 1.67154)).exp(),
        g_draine: (-2.20679 / (d + 3.91029) - 0.428934).exp(),
        alpha: (3.62489 - 8.29288 / (d + 5.52825)).exp(),
        weight_draine: (-0.599085 / (d - 0.641583) - 0.665888).exp(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::experiment::Experiment;

    fn read(keys: &str) -> Result<PhaseFunction, String> {
        let experiment = Experiment::parse(&format!("[medium]\n{keys}")).map_err(|e| e.to_string())?;
        phase(&experiment.medium.one)
    }

    #[test]
    fn droplets_have_the_parameters_of_the_fit() {
        let Ok(PhaseFunction::HenyeyGreensteinDraine { g, g_draine, alpha, weight_draine }) =
            read("droplet-diameter = 15")
        else {
            panic!("--droplet-diameter selects draine");
        };
        let expected = [0.992_596, 0.579_476, 25.051_06, 0.492_820];
        for (found, expected) in [g, g_draine, alpha, weight_draine].into_iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 1e-3, "{found} and not {expected}");
        }
        assert_eq!(read("phase = 'draine'\ndroplet_diameter = 15.0"), read("droplet-diameter = '15'"));
        let given = read("phase = 'draine'\nphase-g = 0.9\nphase-g2 = 0.5\nphase-weight = 0.25\nphase-alpha = 20");
        let expected =
            PhaseFunction::HenyeyGreensteinDraine { g: 0.9, g_draine: 0.5, alpha: 20.0, weight_draine: 0.75 };
        assert_eq!(given, Ok(expected));
    }

    #[test]
    fn a_missing_table_is_named() {
        assert!(read("phase = '/nowhere/fog.csv'").unwrap_err().contains("fog.csv"));
    }

    #[test]
    fn mistakes_name_the_remedy() {
        for (keys, part) in [
            ("phase = 'hg'", "needs --phase-g,"),
            (
                "phase-g = 0.5\nphase = 'isotropic'",
                "--phase-g has no effect in its phase function, which has no parameters",
            ),
            (
                "phase-g = 0.5\nphase-g2 = 0.5",
                "--phase-g2 has no effect in its phase function, which has only --phase-g:",
            ),
            ("phase-g = 0.5\nphase-g2 = 0.1\nphase = 'double-hg'", "--phase-weight"),
            ("phase = 'draine'", "draine needs --droplet-diameter, or"),
            ("phase = 'draine'\nphase-g = 0.5\nphase-g2 = 0.5\nphase-weight = 1", "--phase-alpha"),
            ("droplet-diameter = 10\nphase-alpha = 2", "phase-alpha and droplet-diameter both set the phase function"),
            ("droplet-diameter = 10\nphase = 'hg'", "--droplet-diameter has no effect"),
            ("droplet-diameter = 3", "from 5 to 50"),
            ("phase-alpha = 'x'", "an alpha of Draine"),
        ] {
            let message = read(keys).expect_err(keys);
            assert!(message.contains(part), "{keys}: {message}");
        }
    }
}
