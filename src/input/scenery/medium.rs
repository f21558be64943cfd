//! The medium that the user gives: `[medium]` and its flags.

use glam::DVec3;

use super::grid::grid;
use super::phase::phase;
use crate::error::{Error, Result};
use crate::input::medium_tables::MediumTables;
use crate::scene::{Medium, Scene, check_bounds};
use crate::settings::medium::{Bounds, Coefficient, Distance, RefractiveIndex, Share};
use crate::settings::table::MediumTable;

/// Contrast that a black object keeps at the distance called visibility (Koschmieder 1924), and at the meteorological optical
/// range, MOR (CIE, WMO).
const CONTRAST_AT_VISIBILITY: f64 = 0.02;
const CONTRAST_AT_MOR: f64 = 0.05;
/// Albedo of droplets in visible light.
const DEFAULT_ALBEDO: f64 = 0.99;

/// Replaces the media of the scene by the media of `tables`, if the user gave any. With `no_medium`, only removes the media of the
/// scene. Fails if settings are missing, exclude each other, or have no effect.
pub(super) fn apply(tables: &MediumTables, scene: &mut Scene) -> Result<()> {
    let MediumTables { one, list } = tables;
    if !list.is_empty() {
        if *one != MediumTable::default() {
            return Err(Error::settings(
                "flags describe one medium, but the file has a list [[medium]]: change the list, or use [medium]",
            ));
        }
        let named = list.iter().enumerate().map(|(i, table)| (format!("entry {} of [[medium]]", i + 1), table));
        scene.media = named.map(|(name, table)| checked_medium(table, &name)).collect::<Result<_>>()?;
        return Ok(());
    }
    let no_medium = one.no_medium == Some(true);
    if no_medium {
        scene.media.clear();
    }
    if *one == (MediumTable { no_medium: one.no_medium, ..MediumTable::default() }) {
        return Ok(());
    }
    if no_medium {
        return Err(Error::advice("--no-medium leaves no medium for the other settings: ", "remove one of them"));
    }
    scene.media = vec![checked_medium(&MediumTable { no_medium: None, ..one.clone() }, "the medium")?];
    Ok(())
}

/// The medium of a table. `name` names it in messages.
fn checked_medium(table: &MediumTable, name: &str) -> Result<Medium> {
    if let Some(Bounds(corners)) = table.medium_bounds {
        // Before a grid is read: its file is not to blame.
        check_bounds(&corners.map(DVec3::from), name, "bounds").map_err(Error::settings)?;
    }
    let medium = medium(table).map_err(|message| Error::settings(format!("{name}: {message}")))?;
    medium.check(name).map_err(Error::settings)?;
    Ok(medium)
}

/// The medium of a table in which the user gave at least one setting.
fn medium(table: &MediumTable) -> Result<Medium, String> {
    if table.no_medium.is_some() {
        return Err("no-medium is not a key of a list: remove it, or remove the list".into());
    }
    let (sigma_s, sigma_a) = coefficients(table)?;
    let bounds = table.medium_bounds.map(|Bounds(corners)| corners.map(DVec3::from));
    let index = |given: Option<RefractiveIndex>| given.map(|RefractiveIndex(index)| index as f32);
    let ior = index(table.medium_ior).unwrap_or(1.0);
    let group_ior = index(table.medium_group_ior).unwrap_or(ior);
    let grid = grid(table, bounds)?;
    let bounds = bounds.filter(|_| grid.is_none());
    Ok(Medium { sigma_s, sigma_a, phase: phase(table)?, ior, group_ior, bounds, grid })
}

/// Coefficients of scattering and absorption per metre.
fn coefficients(table: &MediumTable) -> Result<([f64; 3], [f64; 3]), String> {
    let by_visibility = table.visibility.map(|Distance(metres)| -CONTRAST_AT_VISIBILITY.ln() / metres);
    let by_mor = table.mor.map(|Distance(metres)| -CONTRAST_AT_MOR.ln() / metres);
    let given = table.sigma_s.is_some() || table.sigma_a.is_some();
    match by_visibility.or(by_mor) {
        Some(extinction) => {
            let Share(albedo) = table.albedo.unwrap_or(Share(DEFAULT_ALBEDO));
            Ok(([albedo * extinction; 3], [(1.0 - albedo) * extinction; 3]))
        }
        None if table.albedo.is_some() => Err("--albedo needs --visibility or --mor".into()),
        // A medium may be clear, like pure water.
        None if !given && table.medium_ior.is_none() && table.medium_group_ior.is_none() => {
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
        media_of(&format!("[medium]\n{keys}"))
    }

    fn media_of(text: &str) -> Result<Vec<Medium>, String> {
        let experiment = Experiment::parse(text).map_err(|e| e.to_string())?;
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
        let fog = "sigma_s = 0.0027\nsigma-a = '0.0003,0,0'\nphase-g = 0.5\nmedium-bounds = [[6.0, 6.0, 6.0], [550.0, 543.0, 550.0]]";
        let fog = &media(fog).unwrap()[0];
        assert_eq!((fog.sigma_s, fog.sigma_a), ([0.0027; 3], [0.0003, 0.0, 0.0]));
        assert_eq!(fog.phase, PhaseFunction::HenyeyGreenstein { g: 0.5 });
        assert_eq!(fog.bounds, Some([DVec3::splat(6.0), DVec3::new(550.0, 543.0, 550.0)]));
    }

    #[test]
    fn a_list_replaces_the_media_of_the_scene() {
        let list = "[[medium]]\nmor = '50m'\n[[medium]]\nsigma_s = 1\nphase = 'rayleigh'\nmedium-bounds = [[0, 0, 0], [1, 1, 1]]\n";
        let found = media_of(list).unwrap();
        assert_eq!((found.len(), found[1].sigma_s, &found[1].phase), (2, [1.0; 3], &PhaseFunction::Rayleigh));
        let file = Experiment::parse(list).unwrap();
        let flags = |keys: &str| Experiment::parse(&format!("[medium]\n{keys}")).unwrap();
        let merged = |keys: &str| {
            let mut scene = build(Kind::CornellBox);
            apply(&flags(keys).over(file.clone()).medium, &mut scene).map(|()| scene.media.len())
        };
        assert_eq!((merged("").unwrap(), merged("no-medium = true").unwrap()), (2, 0));
        assert!(merged("sigma-s = 1").unwrap_err().to_string().contains("change the list"));
        for (entry, part) in [
            ("phase = 'rayleigh'", "entry 2 of [[medium]]: its coefficients are missing"),
            (
                "sigma_s = 1\nmedium-bounds = [[0, 0, 0], [1, 0, 1]]",
                "entry 2 of [[medium]] has bounds whose first corner",
            ),
            (
                "sigma_s = 1\nmedium-ior = 1.3\nmedium-bounds = [[0, 0, 0], [1, 1, 1]]",
                "entry 2 of [[medium]] has an ior of 1.3",
            ),
            ("sigma-s = 1\nmor = '1m'", "sigma-s and mor both set"),
            ("no_medium = true", "entry 2 of [[medium]]: no-medium is not a key of a list"),
            ("sigma = 1", "line 4, column 1: [[medium]] has no key sigma"),
            ("sigma_s = -1", "line 4, column 11: '-1' is not a coefficient"),
        ] {
            let message = media_of(&format!("[[medium]]\nsigma_s = 1\n[[medium]]\n{entry}")).expect_err(entry);
            assert!(message.contains(part), "{entry}: {message}");
        }
        assert!(media_of("medium = 3").unwrap_err().contains("a table"));
    }

    #[test]
    fn flags_replace_the_other_ways_to_give_a_medium() {
        const TWO_LOBES: &str = "sigma-s = 1\nphase = 'double-hg'\nphase-g = 0.9\nphase-g2 = 0.1\nphase-weight = 0.5";
        let of = |keys: &str| Experiment::parse(&format!("[medium]\n{keys}")).unwrap();
        for (flags, file, merged) in [
            ("mor = '50m'", "sigma-s = 1\nsigma-a = 2\nphase-g = 0.5", "mor = '50m'\nphase-g = 0.5"),
            ("mor = '50m'", "visibility = '9m'\nalbedo = 0.9", "mor = '50m'\nalbedo = 0.9"),
            ("visibility = '50m'", "mor = '9m'", "visibility = '50m'"),
            ("sigma-s = 3", "sigma-s = 1\nsigma-a = 2", "sigma-s = 3\nsigma-a = 2"),
            ("sigma-a = 3", "mor = '9m'\nalbedo = 0.9\nmedium-ior = 1.3", "sigma-a = 3\nmedium-ior = 1.3"),
            ("no-medium = true", "mor = '9m'\nmedium-ior = 1.3", "no-medium = true"),
            ("sigma-s = 3", "no-medium = true", "sigma-s = 3"),
            ("droplet-diameter = 15", TWO_LOBES, "sigma-s = 1\ndroplet-diameter = 15"),
            ("phase = 'rayleigh'", TWO_LOBES, "sigma-s = 1\nphase = 'rayleigh'"),
            ("phase = 'hg'", TWO_LOBES, "sigma-s = 1\nphase = 'hg'\nphase-g = 0.9"),
            ("phase = 'isotropic'", "mor = '9m'\ndroplet-diameter = 15", "mor = '9m'\nphase = 'isotropic'"),
            (
                "phase = 'draine'",
                "mor = '9m'\ndroplet-diameter = 15",
                "mor = '9m'\nphase = 'draine'\ndroplet-diameter = 15",
            ),
            ("phase-g = 0.5", "mor = '9m'\ndroplet-diameter = 15", "mor = '9m'\nphase-g = 0.5"),
            (
                "phase-g = 0.5",
                TWO_LOBES,
                "sigma-s = 1\nphase = 'double-hg'\nphase-g = 0.5\nphase-g2 = 0.1\nphase-weight = 0.5",
            ),
        ] {
            let found = of(flags).over(of(file)).medium;
            assert_eq!(found, of(merged).medium, "{flags} over {file}");
            assert!(apply(&found, &mut build(Kind::CornellBox)).is_ok(), "{flags} over {file}");
        }
    }

    #[test]
    fn water_needs_no_coefficients() {
        let water = &media("medium-ior = 1.33\nmedium-group-ior = 1.35").unwrap()[0];
        assert_eq!((water.ior, water.group_ior, water.sigma_s), (1.33, 1.35, [0.0; 3]));
        // Without a group index, the index of refraction gives the speed of light.
        assert_eq!(media("sigma-a = 0.1\nmedium-ior = '1.33'").unwrap()[0].group_ior, 1.33);
        assert!(media("medium-ior = 0.9").unwrap_err().contains("from 1 to 5"));
        assert!(
            media("medium-ior = 1.33\nmedium-bounds = [[0, 0, 0], [1, 1, 1]]").unwrap_err().contains("limited extent")
        );
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
            (
                "sigma_s = 1\nvisibility = '1m'",
                "sigma-s and visibility both set the coefficients of the medium: keep one",
            ),
            ("mor = '1m'\nvisibility = '1m'", "visibility and mor both set"),
            ("sigma_a = 1\nalbedo = 0.5", "sigma-a and albedo both set"),
            ("mor = '1'", "with its unit"),
            ("sigma_s = 1\nphase-g = 1.0", "-0.999 to 0.999"),
            ("sigma_s = 1\nphase = 'hg'", "needs --phase-g"),
            ("sigma_s = 1\nphase = 'fog'", "not a phase function"),
            ("sigma_s = 1\nphase-g = 0.5\nphase = 'isotropic'", "has no effect"),
            ("sigma_s = 1\nphase-g = 0.5\nphase-g2 = 0.1\nphase = 'double-hg'", "--phase-weight"),
            ("sigma_s = 1\nmedium-bounds = [[0, 0, 0], [1, 0, 1]]", "first corner is not below"),
            ("sigma_s = 1\nmedium-bounds = [0, 0, 0]", "two corners"),
            (
                "sigma_s = 1\ndensity-grid = 'none.npy'\nmedium-bounds = [[1, 1, 1], [0, 0, 0]]",
                "first corner is not below the second",
            ),
            ("sigma_s = 1\nno_medium = true", "remove one of them"),
            ("sigma = 1", "sigma"),
        ];
        for (keys, part) in table {
            let message = media(keys).expect_err(keys);
            assert!(message.contains(part), "{keys}: {message}");
        }
    }
}
