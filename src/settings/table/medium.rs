//! The settings of participating media.

use std::path::PathBuf;

use crate::settings::Filter;
use crate::settings::medium::{
    Alpha, Bounds, Coefficient, Distance, DropletDiameter, MeanCosine, RefractiveIndex, Share,
};
use crate::settings::numbers::Numbers;
use crate::settings::phase::Phase;
use crate::settings::setting::Taker::Page;
use crate::settings::setting::{Form, Setting, table};

table! {
    /// `[medium]`: fog, smoke or water, instead of the media of the scene.
    MediumTable = "medium" {
        /// Scattering coefficient per metre, one number or three for red, green and blue [default: 0]
        sigma_s: Coefficient, Setting::medium("sigma-s", "1/m").also(Page);

        /// Absorption coefficient per metre, one number or three [default: 0]
        sigma_a: Coefficient, Setting::medium("sigma-a", "1/m").also(Page);

        /// Meteorological visibility: the distance at which a black object keeps 2 % of its contrast, such as 60m. Together with
        /// --albedo, it gives the coefficients
        visibility: Distance, Setting::medium("visibility", "LENGTH").excludes(&["sigma-s", "sigma-a"], "set the coefficients of the medium").also(Page);

        /// Meteorological optical range: as --visibility, but with 5 % of the contrast
        mor: Distance, Setting::medium("mor", "LENGTH").excludes(&["sigma-s", "sigma-a", "visibility"], "set the coefficients of the medium").also(Page);

        /// Share of the light that an event scatters instead of absorbing it, for --visibility and --mor [default: 0.99]
        albedo: Share, Setting::medium("albedo", "0..1").excludes(&["sigma-s", "sigma-a"], "set the coefficients of the medium").also(Page);

        /// How light is scattered: isotropic, hg (Henyey-Greenstein), double-hg, draine (droplets of water), rayleigh, or a table
        /// of cosines and values in a CSV file [default: draine if there is a --droplet-diameter, hg if there is a --phase-g, else
        /// isotropic]
        phase: Phase, Setting::medium("phase", "NAME|FILE.csv");

        /// Mean cosine of the scattering angle, for hg and the first lobe of double-hg and draine; positive is forwards
        phase_g: MeanCosine, Setting::medium("phase-g", "-1..1").form(Form::Signed).old_key("g").also(Page);

        /// Mean cosine of the second lobe of double-hg, or parameter g of the second lobe of draine
        phase_g2: MeanCosine, Setting::medium("phase-g2", "-1..1").form(Form::Signed).old_key("g2");

        /// Share of the first lobe of double-hg and draine
        phase_weight: Share, Setting::medium("phase-weight", "0..1").old_key("weight");

        /// Parameter alpha of the second lobe of draine
        phase_alpha: Alpha, Setting::medium("phase-alpha", "ALPHA").old_key("alpha");

        /// Diameter of water droplets, from 5 to 50 micrometres; it sets all parameters of draine
        droplet_diameter: DropletDiameter, Setting::medium("droplet-diameter", "MICROMETRES").excludes(&["phase-g", "phase-g2", "phase-weight", "phase-alpha"], "set the phase function").resets(&["phase"]);

        /// Index of refraction of a medium that fills all space, like 1.33 for water: solids refract relative to it [default: 1]
        medium_ior: RefractiveIndex, Setting::medium("medium-ior", "1..5").old_key("ior");

        /// Group index of a medium that fills all space: light takes this many times the distance outside of solids [default:
        /// --medium-ior]
        medium_group_ior: RefractiveIndex, Setting::medium("medium-group-ior", "1..5").old_key("group-ior");

        /// Densities that multiply the coefficients: a Mitsuba volume (.vol), or a NumPy array (.npy) of shape (nz, ny, nx) with
        /// --medium-bounds, the box of the grid
        density_grid: PathBuf, Setting::medium("density-grid", "FILE.vol|FILE.npy").old_key("grid");

        /// Density between the centres of voxels: linear, or nearest for voxels of constant density [default: linear]
        grid_filter: Filter, Setting::medium("grid-filter", "FILTER");

        /// Places the grid in the scene: the three rows of a 3 x 4 matrix, 12 numbers [default: no change]
        grid_transform: Numbers<12>, Setting::medium("grid-transform", "NUMBERS").form(Form::Signed);

        /// Box that the medium or its grid fills, given by two corners in metres [default: all space, or the bounds of the .vol file]
        medium_bounds: Bounds, Setting::medium("medium-bounds", "X,Y,Z,X,Y,Z").form(Form::Signed).old_key("bounds");

        /// Render without the media of the scene
        no_medium: bool, Setting::medium("no-medium", "").form(Form::Switch).also(Page);
    }
}
