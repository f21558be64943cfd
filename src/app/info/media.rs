//! The media in the report of `taugate info`.

use serde::Serialize;
use taugate::internals::gpu::buffer_desc::mebibytes;
use taugate::internals::job::feasible::short;
use taugate::internals::render::{ViewThickness, grid};
use taugate::internals::scene::{Medium as SceneMedium, PhaseFunction, Scene};

/// A medium. Lengths are in metres; numbers are means over the channels.
#[derive(Serialize)]
pub struct Medium {
    /// Mean distance between two events where the density is 1. None if the medium neither scatters nor absorbs.
    mean_free_path: Option<f64>,
    /// Fraction of the events that scatter; the others absorb.
    scattering_share: Option<f64>,
    phase: &'static str,
    ior: f32,
    group_ior: f32,
    /// Lower and upper corner; none if the medium fills all space, or if only its grid bounds it.
    bounds: Option<[[f64; 3]; 2]>,
    /// Voxels along x, y and z.
    grid: Option<[u32; 3]>,
    /// Memory of the densities on the host.
    grid_bytes: u64,
    /// Memory of the cells and blocks of the grid on the device.
    grid_device_bytes: u64,
}

impl Medium {
    pub fn new(medium: &SceneMedium) -> Medium {
        let extinction = medium.extinction();
        let scattering = medium.sigma_s.iter().sum::<f64>() / 3.0;
        let some = |value: f64| (extinction > 0.0).then_some(value / extinction);
        Medium {
            mean_free_path: some(1.0),
            scattering_share: some(scattering),
            phase: match medium.phase {
                PhaseFunction::Isotropic => "isotropic",
                PhaseFunction::HenyeyGreenstein { .. } => "hg",
                PhaseFunction::DoubleHenyeyGreenstein { .. } => "double-hg",
                PhaseFunction::HenyeyGreensteinDraine { .. } => "draine",
                PhaseFunction::Rayleigh => "rayleigh",
                PhaseFunction::Table { .. } => "a table",
            },
            ior: medium.ior,
            group_ior: medium.group_ior,
            bounds: medium.bounds.map(|bounds| bounds.map(|corner| corner.to_array())),
            grid: medium.grid.as_ref().map(|grid| grid.resolution),
            grid_bytes: medium.grid.as_ref().map_or(0, |grid| size_of_val(&grid.density[..]) as u64),
            grid_device_bytes: medium
                .grid
                .as_ref()
                .map_or(0, |g| grid::texel_count(g) * size_of::<grid::Texel>() as u64),
        }
    }

    /// Mean free path, share of scattering and phase function.
    pub fn events(&self) -> String {
        match (self.mean_free_path, self.scattering_share) {
            (Some(path), Some(share)) => {
                format!(
                    "mean free path {} m, {} % scattered, phase function {}",
                    short(path),
                    short(100.0 * share),
                    self.phase
                )
            }
            _ => "clear".into(),
        }
    }

    pub fn describe(&self) -> String {
        let events = self.events();
        let index = match (self.ior, self.group_ior) {
            (1.0, 1.0) => String::new(),
            (ior, group_ior) => format!(", index {ior} (group index {group_ior})"),
        };
        let corner = |p: &[f64; 3]| format!("({}, {}, {})", short(p[0]), short(p[1]), short(p[2]));
        let extent = match (&self.bounds, self.grid) {
            (None, None) => ", in all space".into(),
            (None, Some(_)) => String::new(),
            (Some([lo, hi]), _) => format!(", from {} to {} m", corner(lo), corner(hi)),
        };
        let grid = self.grid.map_or(String::new(), |[x, y, z]| {
            let [host, device] = [self.grid_bytes, self.grid_device_bytes].map(mebibytes);
            format!(", grid of {x}x{y}x{z} voxels ({host} on the host, {device} on the device)")
        });
        format!("{events}{index}{extent}{grid}")
    }
}

/// Optical thickness of the media along camera rays, without media inside of meshes. `None` stands for infinity: a ray that leaves the
/// scene through a medium.
#[derive(Serialize)]
pub struct Thickness {
    centre: Option<f64>,
    least: Option<f64>,
    greatest: Option<f64>,
    /// Fraction of the light that goes straight through the centre, as a mean over the channels.
    transmitted: f64,
    /// Whether the scene has media inside of meshes, which do not count here.
    leaves_out_interiors: bool,
}

impl Thickness {
    pub fn new(along: ViewThickness, scene: &Scene) -> Thickness {
        let finite = |x: f64| x.is_finite().then_some(x);
        Thickness {
            centre: finite(along.centre),
            least: finite(along.least),
            greatest: finite(along.greatest),
            transmitted: along.transmitted,
            leaves_out_interiors: scene
                .meshes
                .iter()
                .any(|mesh| scene.materials[mesh.material as usize].interior.is_some()),
        }
    }

    pub fn describe(&self) -> String {
        let number = |x: Option<f64>| x.map_or("unlimited".into(), short);
        let left = match self.transmitted {
            0.0 => "none of".into(),
            fraction => format!("{} % of", short(100.0 * fraction)),
        };
        let without = if self.leaves_out_interiors { " (without media inside of meshes)" } else { "" };
        format!(
            "optical thickness{without} {} along the central ray, from {} to {} over the view; {left} the light goes straight through \
             the centre",
            number(self.centre),
            number(self.least),
            number(self.greatest)
        )
    }
}

#[cfg(test)]
mod tests {
    use taugate::internals::scene::{Material, Mesh};

    use super::*;

    #[test]
    fn the_thickness_says_that_media_inside_of_meshes_do_not_count() {
        let along = ViewThickness { centre: 2.0, least: 1.0, greatest: f64::INFINITY, transmitted: 0.25 };
        let text = |interior: Option<SceneMedium>| {
            let (materials, meshes) = (vec![Material { interior, ..Material::glass("glass") }], vec![Mesh::default()]);
            Thickness::new(along, &Scene { materials, meshes, ..Scene::default() }).describe()
        };
        let rest = "2.0000 along the central ray, from 1.0000 to unlimited over the view; 25.000 % of the light goes straight through \
                    the centre";
        assert_eq!(text(None), format!("optical thickness {rest}"));
        let without = "optical thickness (without media inside of meshes)";
        assert_eq!(text(Some(SceneMedium::default())), format!("{without} {rest}"));
    }
}
