//! The medium that the user gives: `[medium]` and its flags.

use glam::DVec3;

use super::phase::phase;
use crate::error::{Error, Result};
use crate::scene::{Medium, Scene};
use crate::settings::medium::{Bounds, Coefficient, Distance, Share};
use crate::settings::table::MediumTable;

/// Contrast that a black object keeps at the visibility (Koschmieder 1924), and at the meteorological optical range (CIE, WMO).
const CONTRAST_AT_VISIBILITY: f64 = 0.02;
const CONTRAST_AT_MOR: f64 = 0.05;
/// Albedo of droplets in visible light.
const DEFAULT_ALBEDO: f64 = 0.99;

/// Replaces the media of the scene by the medium of `table`, if the user gave one; removes them with `no_medium`. Fails if
/// settings are missing, exclude each other, or have no effect.
pub(super) fn apply(table: &MediumTable, scene: &mut Scene) -> Result<()> {
    let no_medium = table.no_medium == Some(true);
    if no_medium {
        scene.media.clear();
    }
    if *table == (MediumTable { no_medium: table.no_medium, ..MediumTable::default() }) {
        return Ok(());
    }
    if no_medium {
        return Err(Error::Settings("--no-medium leaves no medium for the other settings: remove one of them".into()));
    }
    scene.media = vec![medium(table).map_err(|message| Error::Settings(format!("the medium: {message}")))?];
    scene.check()
}

/// The medium of a table in which the user gave at least one setting.
fn medium(table: &MediumTable) -> Result<Medium, String> {
    let (sigma_s, sigma_a) = coefficients(table)?;
    let bounds = table.bounds.map(|Bounds(corners)| corners.map(DVec3::from));
    Ok(Medium { sigma_s, sigma_a, phase: phase(table)?, bounds, ..Medium::default() })
}

/// Coefficients of scattering and absorption per metre.
fn coefficients(table: &MediumTable) -> Result<([f64; 3], [f64; 3]), String> {
    let extinction = match (table.visibility, table.mor) {
        (None, None) => None,
        (Some(Distance(metres)), None) => Some(-CONTRAST_AT_VISIBILITY.ln() / metres),
        (None, Some(Distance(metres))) => Some(-CONTRAST_AT_MOR.ln() / metres),
        (Some(_), Some(_)) => return Err("--visibility and --mor say the same: keep one".into()),
    };
    let given = table.sigma_s.is_some() || table.sigma_a.is_some();
    match extinction {
        Some(_) if given => {
            Err("--visibility and --mor exclude --sigma-s and --sigma-a: keep one kind of settings".into())
        }
        Some(extinction) => {
            let Share(albedo) = table.albedo.unwrap_or(Share(DEFAULT_ALBEDO));
            Ok(([albedo * extinction; 3], [(1.0 - albedo) * extinction; 3]))
        }
        None if table.albedo.is_some() => {
            Err("--albedo needs --visibility or --mor; with --sigma-s, give --sigma-a".into())
        }
        None if !given => {
            Err("its coefficients are missing: give --sigma-s and --sigma-a, --visibility or --mor".into())
        }
        None => {
            let rgb = |coefficient: Option<Coefficient>| coefficient.map_or([0.0; 3], |Coefficient(rgb)| rgb);
            Ok((rgb(table.sigma_s), rgb(table.sigma_a)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Kind, build};
    use crate::input::experiment::Experiment;
    use crate::scene::PhaseFunction;

    fn media(keys: &str) -> Result<Vec<Medium>, String> {
        let experiment = Experiment::parse(&format!("[medium]\n{keys}")).map_err(|e| e.to_string())?;
        assert_eq!(Experiment::parse(&experiment.to_toml()).unwrap(), experiment, "{}", experiment.to_toml());
        let mut scene = build(Kind::CornellBox);
        scene.media = vec![Medium { sigma_s: [7.0; 3], ..Medium::default() }];
        apply(&experiment.medium, &mut scene).map_err(|e| e.to_string())?;
        Ok(scene.media)
    }

    #[test]
    fn a_medium_replaces_those_of_the_scene() {
        assert_eq!(media("").unwrap()[0].sigma_s, [7.0; 3]);
        assert!(media("no_medium = true").unwrap().is_empty());
        let fog =
            "sigma_s = 0.0027\nsigma-a = '0.0003,0,0'\ng = 0.5\nbounds = [[6.0, 6.0, 6.0], [550.0, 543.0, 550.0]]";
        let fog = &media(fog).unwrap()[0];
        assert_eq!((fog.sigma_s, fog.sigma_a), ([0.0027; 3], [0.0003, 0.0, 0.0]));
        assert_eq!(fog.phase, PhaseFunction::HenyeyGreenstein { g: 0.5 });
        assert_eq!(fog.bounds, Some([DVec3::splat(6.0), DVec3::new(550.0, 543.0, 550.0)]));
    }

    #[test]
    fn visibilities_are_those_of_the_definitions() {
        let fog = &media("visibility = '60m'\nalbedo = 0.9").unwrap()[0];
        let extinction = fog.sigma_s[0] + fog.sigma_a[0];
        assert!((extinction * 60.0 - 3.912).abs() < 1e-3 && (fog.sigma_s[0] / extinction - 0.9).abs() < 1e-12);
        let fog = &media("mor = '0.06km'").unwrap()[0];
        assert!(((fog.sigma_s[0] + fog.sigma_a[0]) * 60.0 - 2.996).abs() < 1e-3);
    }

    #[test]
    fn mistakes_name_the_remedy() {
        let table = [
            ("albedo = 0.5", "--albedo needs --visibility"),
            ("phase = 'rayleigh'", "coefficients are missing"),
            ("sigma_s = -1", "not a coefficient per metre"),
            ("sigma_s = [1, 2]", "like 0.04"),
            ("sigma_s = 1\nvisibility = '1m'", "keep one kind"),
            ("mor = '1m'\nvisibility = '1m'", "say the same"),
            ("mor = '1'", "with its unit"),
            ("sigma_s = 1\ng = 1.0", "-0.999 to 0.999"),
            ("sigma_s = 1\nphase = 'hg'", "needs --phase-g"),
            ("sigma_s = 1\nphase = 'fog'", "not a phase function"),
            ("sigma_s = 1\ng = 0.5\nphase = 'isotropic'", "has no effect"),
            ("sigma_s = 1\ng = 0.5\ng2 = 0.1\nphase = 'double-hg'", "--phase-weight"),
            ("sigma_s = 1\nbounds = [[0, 0, 0], [1, 0, 1]]", "first corner is not below"),
            ("sigma_s = 1\nbounds = [0, 0, 0]", "two corners"),
            ("sigma_s = 1\nno_medium = true", "remove one of them"),
            ("sigma = 1", "sigma"),
        ];
        for (keys, part) in table {
            let message = media(keys).expect_err(keys);
            assert!(message.contains(part), "{keys}: {message}");
        }
    }
}
