//! Thin glass of a scene: which surfaces it is, how long it delays light, and warnings about glass that is probably meant otherwise.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};

use crate::scene::{Material, Mesh, Scene, surrounding_indices};

/// A ray is assumed to cross a curved sheet at most this often, if the sheet delays light.
const CROSSINGS: usize = 8;
/// Edges of a mesh that counts as one of few triangles.
const FEW_EDGES: usize = 24;
/// Largest thickness of a slab relative to its width, and smallest width of a pane relative to its thickness.
const SLAB: f64 = 0.2;
const PANE: f64 = 10.0;
/// A segment is assumed to pass at most this many sheets that delay light.
const MAX_DELAYS: usize = 16;

/// Upper bound in metres on the delay of light by thin glass on one segment of a path. The delay by a sheet of thickness d is largest
/// along the sheet: d sqrt(n^2 - n0^2), where n and n0 are the indices of refraction of the glass and outside.
pub fn max_delay(scene: &Scene) -> f64 {
    let [outside, _] = surrounding_indices(&scene.media).map(f64::from);
    let mut delays = vec![];
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh as usize];
        let material = &scene.materials[mesh.material as usize];
        let thickness = f64::from(material.thickness_in(&instance.transform, mesh));
        if thickness == 0.0 || !material.is_sheet(mesh) {
            continue;
        }
        let delay = thickness * (f64::from(material.ior).powi(2) - outside * outside).max(0.0).sqrt();
        let crossings = if mesh.is_flat() { 1 } else { CROSSINGS.min(mesh.triangles.len()) };
        delays.extend(std::iter::repeat_n(delay, crossings));
    }
    delays.sort_by(|a, b| b.total_cmp(a));
    delays.iter().take(MAX_DELAYS).sum()
}

/// Whether the same objects in two scenes have the same thickness as thin glass.
pub fn have_same_thickness(a: &Scene, b: &Scene) -> bool {
    let thickness = |scene: &Scene, k: usize| {
        let instance = &scene.instances[k];
        let mesh = &scene.meshes[instance.mesh as usize];
        scene.materials[mesh.material as usize].thickness_in(&instance.transform, mesh)
    };
    (0..a.instances.len()).all(|k| thickness(a, k) == thickness(b, k))
}

/// Glass of a scene whose surfaces are all thin, or all solid.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Glass {
    /// Name of the material.
    pub material: String,
    /// Whether light passes straight on.
    pub thin: bool,
    /// Why, as the rest of a sentence.
    pub why: String,
}

/// The glass of the scene: one entry per material and kind, in the order of the materials.
pub fn glass(scene: &Scene) -> Vec<Glass> {
    let mut kinds: BTreeMap<(u32, bool), Vec<&str>> = BTreeMap::new();
    for mesh in placed_meshes(scene) {
        let material = &scene.materials[mesh.material as usize];
        if material.transmits() && !material.is_null_boundary(mesh, surrounding_indices(&scene.media)[0]) {
            kinds.entry((mesh.material, material.is_sheet(mesh))).or_default().push(&mesh.name);
        }
    }
    let kinds = kinds.into_iter().map(|((index, thin), meshes)| {
        let material = &scene.materials[index as usize];
        let why = match (material.thin, thin) {
            (Some(_), _) => "as extras.thin or --thin-glass says".into(),
            (None, true) => format!("because {} is not closed", named(&meshes)),
            (None, false) => format!("because {} is closed", named(&meshes)),
        };
        Glass { material: material.name.clone(), thin, why }
    });
    kinds.collect()
}

/// Warnings about thin glass that is probably meant to be solid, and about properties that have no effect; one sentence each.
pub fn warnings(scene: &Scene) -> Vec<String> {
    let mut warnings = vec![];
    let mut named: Vec<(u32, Kind)> = vec![];
    for mesh in placed_meshes(scene) {
        let material = &scene.materials[mesh.material as usize];
        if !material.is_sheet(mesh) {
            continue;
        }
        let open_edges = mesh.open_edges();
        for kind in [
            Kind::Turned,
            Kind::AlmostClosed,
            Kind::Slab,
            Kind::Water,
            Kind::RoughDelay,
            Kind::NoThickness,
            Kind::Scatters,
        ] {
            if kind.applies(material, mesh, open_edges) && !named.contains(&(mesh.material, kind)) {
                named.push((mesh.material, kind));
                warnings.push(kind.text(material, mesh, open_edges));
            }
        }
    }
    warnings
}

/// What may be wrong with thin glass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// All edges have two triangles, but some of the triangles are turned around.
    Turned,
    /// A closed pane whose two faces count as two panes.
    Slab,
    /// A few triangles of a solid are missing.
    AlmostClosed,
    /// An open mesh with a thickness from KHR_materials_volume: often water without a bottom, or two faces of a pane.
    Water,
    /// Rough thin glass with a thickness, which does not delay light.
    RoughDelay,
    /// Glass that absorbs, but has no thickness.
    NoThickness,
    /// Glass with a medium that scatters.
    Scatters,
}

impl Kind {
    /// `open_edges`: those of `mesh`.
    fn applies(self, material: &Material, mesh: &Mesh, open_edges: usize) -> bool {
        let is_rough = material.roughness * material.roughness >= super::material::DELTA_ALPHA;
        let thickness = material.thickness + material.volume_thickness;
        match self {
            Kind::Turned => material.thin.is_none() && !mesh.is_flat() && open_edges > 0 && mesh.unpaired_edges() == 0,
            // Many edges of a patch with few triangles are open. So are those of a box that lacks one triangle.
            Kind::AlmostClosed => {
                let share = if edges(mesh) <= FEW_EDGES { 4 } else { 10 };
                let is_almost = share * open_edges < edges(mesh) && mesh.unpaired_edges() > 0;
                material.thin.is_none() && !mesh.is_flat() && is_almost && is_folded(mesh)
            }
            Kind::Slab => material.thin == Some(true) && open_edges == 0 && is_slab(mesh),
            Kind::Water => {
                material.thin.is_none()
                    && material.volume_thickness > 0.0
                    && !is_pane(mesh, material.volume_thickness)
                    && ![Kind::Turned, Kind::AlmostClosed].iter().any(|kind| kind.applies(material, mesh, open_edges))
            }
            Kind::RoughDelay => is_rough && thickness > 0.0,
            Kind::NoThickness => {
                thickness == 0.0 && material.interior.as_ref().is_some_and(|medium| medium.sigma_a != [0.0; 3])
            }
            Kind::Scatters => material.interior.as_ref().is_some_and(|medium| medium.sigma_s != [0.0; 3]),
        }
    }

    fn text(self, material: &Material, mesh: &Mesh, open_edges: usize) -> String {
        let (name, mesh_name) = (&material.name, &mesh.name);
        match self {
            Kind::Turned => format!(
                "mesh '{mesh_name}' of glass '{name}' would be closed, but some of its triangles face inwards and others outwards, so it is \
                 thin: light passes straight on; turn its triangles to one side, or render with --thin-glass none if it is solid"
            ),
            Kind::Slab => format!(
                "mesh '{mesh_name}' of glass '{name}' is thin glass with two faces, and each of them counts as a pane, so light that passes \
                 both is dimmed and delayed twice; leave out one of the two faces"
            ),
            Kind::AlmostClosed => format!(
                "mesh '{mesh_name}' of glass '{name}' is almost closed ({open_edges} of {} edges are open), but open glass is thin: light \
                 passes straight on; close the mesh, or render with --thin-glass none if it is solid",
                edges(mesh)
            ),
            Kind::Water => format!(
                "mesh '{mesh_name}' of glass '{name}' is open and has a thickness, so it is thin glass; set extras.thin = true if it is a \
                 pane, and leave out one of two parallel faces; close the mesh if it is the surface of water or of another solid"
            ),
            Kind::RoughDelay => {
                format!(
                    "the thin glass '{name}' is rough, so its thickness does not delay light; lower its roughness to 0 if it should"
                )
            }
            Kind::NoThickness => {
                format!(
                    "the thin glass '{name}' has no thickness, so its medium absorbs nothing; set extras.thickness in metres"
                )
            }
            Kind::Scatters => format!(
                "the thin glass '{name}' contains a medium that scatters, but thin glass only absorbs; set extras.thin = false, or \
                 leave out --thin-glass all, if it should scatter"
            ),
        }
    }
}

/// Whether a mesh is a slab: its bounding box is much thinner than wide.
fn is_slab(mesh: &Mesh) -> bool {
    let [lo, hi] = mesh.bounds();
    let mut sides = (hi - lo).to_array();
    sides.sort_by(f64::total_cmp);
    sides[0] < SLAB * sides[1]
}

/// Whether a mesh is flat and much larger than `thickness`, as a pane that is modelled as one plane. The surface of water is not.
fn is_pane(mesh: &Mesh, thickness: f32) -> bool {
    let [lo, hi] = mesh.bounds();
    mesh.is_flat() && (hi - lo).max_element() > PANE * f64::from(thickness)
}

/// Whether the triangles of a mesh face so many ways that the sum of their area vectors is short: 0 for a closed mesh, and almost the area
/// for a curved windscreen, whose fine grid has few open edges.
fn is_folded(mesh: &Mesh) -> bool {
    let (mut sum, mut area) = (DVec3::ZERO, 0.0);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|corner| Vec3::from(mesh.positions[corner as usize]).as_dvec3());
        let vector = (b - a).cross(c - a);
        sum += vector;
        area += vector.length();
    }
    sum.length() < 0.5 * area
}

/// About the number of edges of a mesh: two triangles share an edge.
fn edges(mesh: &Mesh) -> usize {
    3 * mesh.triangles.len() / 2
}

/// The meshes that at least one instance places.
fn placed_meshes(scene: &Scene) -> impl Iterator<Item = &Mesh> {
    let mut is_placed = vec![false; scene.meshes.len()];
    scene.instances.iter().for_each(|instance| is_placed[instance.mesh as usize] = true);
    scene.meshes.iter().zip(is_placed).filter_map(|(mesh, is_placed)| is_placed.then_some(mesh))
}

/// The meshes in words: the first name, and the number of others.
fn named(meshes: &[&str]) -> String {
    match meshes {
        [] => String::new(),
        [mesh] => format!("mesh '{mesh}'"),
        [mesh, others @ ..] => format!("mesh '{mesh}' (like {} more)", others.len()),
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;
    use crate::generate::shapes::{cuboid, icosphere, quad};
    use crate::scene::Medium;

    /// A scene with one mesh of glass.
    fn of(material: Material, shape: Mesh) -> Scene {
        let mut scene = Scene::default();
        let material = scene.add_material(material);
        scene.add_surface(Mesh { name: "mesh".into(), ..shape }, material);
        scene
    }

    fn plane() -> Mesh {
        quad(DVec3::ZERO, DVec3::X, DVec3::Y, [1.0; 2])
    }

    #[test]
    fn open_glass_is_thin_and_closed_glass_is_solid_unless_the_material_says_otherwise() {
        let cube = || cuboid(DVec3::ZERO, DVec3::ONE);
        let thin = |thin, shape| glass(&of(Material { thin, ..Material::glass("pane") }, shape))[0].thin;
        assert!(thin(None, plane()) && !thin(None, cube()));
        assert!(thin(Some(true), cube()) && !thin(Some(false), plane()));
        let why = &glass(&of(Material::glass("pane"), plane()))[0].why;
        assert_eq!(why, "because mesh 'mesh' is not closed");
        assert!(glass(&of(Material::diffuse("grey", [0.5; 3]), plane())).is_empty());
    }

    /// Along the sheet, d (n cos theta' - cos theta) is d sqrt(n^2 - 1). The thickness of KHR_materials_volume is scaled with the mesh.
    #[test]
    fn the_delay_is_that_of_grazing_light_for_each_crossing() {
        let pane = Material { thickness: 0.1, ..Material::glass("pane") };
        let once = 0.1 * 1.25f64.sqrt();
        let near = |found: f64, truth: f64| assert!((found - truth).abs() < 1e-6 * truth, "{found}, not {truth}");
        near(max_delay(&of(pane.clone(), plane())), once);
        let mut bowl = icosphere(1.0, 2);
        bowl.triangles.truncate(200);
        near(max_delay(&of(pane, bowl)), 8.0 * once);
        let mut scene = of(Material { volume_thickness: 0.1, ..Material::glass("pane") }, plane());
        scene.instances[0].transform = DAffine3::from_scale(DVec3::splat(3.0));
        near(max_delay(&scene), 3.0 * once);
        // Along the plane, the scale does not count.
        let mut wide = scene.clone();
        wide.instances[0].transform = DAffine3::from_scale(DVec3::new(9.0, 9.0, 3.0));
        let mut thick = scene.clone();
        thick.instances[0].transform = DAffine3::from_scale(DVec3::splat(2.0));
        assert!(have_same_thickness(&scene, &wide) && !have_same_thickness(&scene, &thick));
        let solid = Material { thickness: 0.1, thin: Some(false), ..Material::glass("block") };
        assert_eq!(max_delay(&of(solid, plane())), 0.0);
    }

    #[test]
    fn glass_that_is_probably_meant_otherwise_is_named() {
        let warned = |material: Material, shape: Mesh| warnings(&of(material, shape)).concat();
        assert_eq!(warned(Material::glass("pane"), plane()), "");
        let mut open = icosphere(1.0, 2);
        open.triangles.pop();
        assert!(warned(Material::glass("ball"), open.clone()).contains("almost closed (3 of 478 edges are open)"));
        assert_eq!(warned(Material { thin: Some(true), ..Material::glass("bulb") }, open), "");
        let mut cap = icosphere(1.0, 4);
        let is_low = |cap: &Mesh, t: &[u32; 3]| t.iter().any(|&corner| cap.positions[corner as usize][2] < 0.8);
        cap.triangles = cap.triangles.iter().filter(|t| !is_low(&cap, t)).copied().collect();
        assert_eq!(warned(Material::glass("curved windscreen"), cap), "");
        let mut block = cuboid(DVec3::ZERO, DVec3::ONE);
        block.triangles[3].swap(0, 1);
        assert!(warned(Material::glass("block"), block.clone()).contains("some of its triangles face inwards"));
        block.triangles.remove(3);
        assert!(warned(Material::glass("block"), block).contains("almost closed (3 of 16 edges are open)"));
        let slab = cuboid(DVec3::ZERO, DVec3::new(1.0, 1.0, 0.02));
        let thin = Material { thin: Some(true), ..Material::glass("pane") };
        assert!(warned(thin.clone(), slab).contains("each of them counts as a pane"));
        assert_eq!(warned(thin, cuboid(DVec3::ZERO, DVec3::ONE)), "");
        // glTF gives the thickness of a pane that is one plane.
        assert_eq!(warned(Material { volume_thickness: 0.01, ..Material::glass("pane") }, plane()), "");
        let water = Material { volume_thickness: 1.0, ..Material::glass("water") };
        assert!(warned(water, plane()).contains("close the mesh if it is the surface of water"));
        let rough = Material { thickness: 0.01, roughness: 0.3, ..Material::glass("frosted") };
        assert!(warned(rough, plane()).contains("its thickness does not delay light"));
        let absorbing = Some(Medium { sigma_a: [1.0; 3], ..Medium::default() });
        assert!(
            warned(Material { interior: absorbing, ..Material::glass("grey") }, plane()).contains("has no thickness")
        );
        let milk = Some(Medium { sigma_s: [1.0; 3], ..Medium::default() });
        let forced = Material { interior: milk, thin: Some(true), ..Material::glass("milk") };
        assert!(warned(forced, cuboid(DVec3::ZERO, DVec3::ONE)).contains("thin glass only absorbs"));
    }
}
