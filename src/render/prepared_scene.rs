//! A scene that the host has prepared for rendering: it is flattened, its BVH is built, and its emitters are collected.

use std::collections::{BTreeMap, HashSet};
use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::albedo::AlbedoTable;
use super::emitters::EmitterSet;
use super::geometry::Geometry;
use super::media::Media;
use super::missing_light::{MissingLight, missing_light};
use super::solids::Solids;
use super::space::RenderSpace;
use super::travel_time_bounds::{Box3, TravelTimeBounds};
use super::{
    coplanar, far_objects, glass_checks, grid, memory, null_boundary, oversized, pinhole_in_fog, sheets, velocities,
};
use crate::error::{Error, Result};
use crate::scene::{Camera, Light, Medium, Scene};
use crate::settings::{Emitters, Settings};

/// All scene data for the upload, in the render space around one camera and with one selection of emitters.
pub struct PreparedScene {
    pub(super) geometry: Arc<Geometry>,
    pub(super) solids: Arc<Solids>,
    pub(super) emitters: EmitterSet,
    pub(super) media: Arc<Media>,
    pub(super) albedo: &'static AlbedoTable,
    pub(super) space: RenderSpace,
    /// Bounding box, in render space, of the points where camera rays start.
    pub(super) sensor: Box3,
    /// The rays of a camera with [`crate::scene::Projection::Aimed`]; else empty.
    pub(super) aims: Vec<[f32; 4]>,
    /// See [`velocities::table`].
    pub(super) velocities: Vec<[f32; 4]>,
    /// Whether each pixel has a laser of its own, see [`PreparedScene::with_own_lasers`].
    pub(super) has_own_lasers: bool,
    /// For paths of one segment. Empty until they are needed, and again after lights or surfaces have moved.
    travel_time_bounds: OnceLock<TravelTimeBounds>,
}

impl PreparedScene {
    /// Fails if [`Scene::check`] fails, if the camera or a selected emitter does not exist, or if nothing emits. A light that is
    /// infinitely far away must not be selected in a gated render, nor with a medium that fills all space. Also fails if a mesh that
    /// bounds a medium is not closed, or if the device cannot render a medium.
    pub fn new(scene: &Scene, settings: &Settings) -> Result<PreparedScene> {
        PreparedScene::in_space(scene, settings, |camera| RenderSpace::of_camera(scene, camera, settings.emitters()))
    }

    /// As [`PreparedScene::new`], in the render space that `space` chooses for the camera.
    pub fn in_space(
        scene: &Scene,
        settings: &Settings,
        space: impl FnOnce(&Camera) -> RenderSpace,
    ) -> Result<PreparedScene> {
        scene.check()?;
        null_boundary::check(scene)?;
        let Some(camera) = scene.cameras.get(settings.camera()) else {
            let (camera, count) = (settings.camera(), scene.cameras.len());
            return Err(Error::settings(format!(
                "camera {camera} does not exist; the scene has {count} of them, numbered from 0"
            )));
        };
        check_emitters(scene, settings)?;
        memory::check_build(scene)?;
        let albedo = AlbedoTable::shared();
        let space = space(camera);
        let geometry = Arc::new(Geometry::new(scene, &space, settings.emitters(), albedo));
        let solids = Arc::new(Solids::new(&geometry));
        let emitters = EmitterSet::new(scene, settings.emitters(), &space, &geometry, &solids);
        if emitters.table.is_empty() {
            return Err(Error::settings(
                "nothing emits light (a light of power 0 or an emissive surface without area does not count): add a light with \
                 --headlamp, or select other nodes with --emitters",
            ));
        }
        let sensor = sensor(camera, settings, &space);
        let media = Arc::new(Media::new(scene, &space)?);
        let aims = space.aims(camera);
        let velocities = velocities::table(scene, settings, &emitters, &space)?;
        let (has_own_lasers, travel_time_bounds) = (false, OnceLock::new());
        Ok(PreparedScene {
            geometry,
            solids,
            emitters,
            media,
            albedo,
            space,
            sensor,
            aims,
            velocities,
            has_own_lasers,
            travel_time_bounds,
        })
    }

    /// Gives each pixel of an aimed camera a laser of its own, as the beams of a LiDAR have. The only light must be a spot at the
    /// camera's place. For each pixel, its axis is the direction in which the pixel looks, and the random numbers are those of the first
    /// pixel of a render with the pixel's seed. So an image of many beams has the bits of the images of single beams. Renders must have a
    /// `max_depth` of at most 2.
    ///
    /// # Panics
    /// If there is not one seed per aimed ray.
    pub fn with_own_lasers(mut self, seeds: &[u32]) -> PreparedScene {
        set_seeds(&mut self.aims, seeds);
        self.has_own_lasers = true;
        self
    }

    /// Updates the emitters after lights without a surface have moved. The camera may have moved too, but `self` keeps the old one: pass
    /// the new camera to [`Renderer::set_camera`](super::Renderer::set_camera). The rest of `scene` must be as before, and `settings` must
    /// select the same camera and emitters. Returns false and changes nothing if the scene must be prepared again. This is so if other
    /// lights emit, if a light is infinitely far away, or if the render space changes.
    pub fn follow(&mut self, scene: &Scene, settings: &Settings) -> Result<bool> {
        let space = RenderSpace::of_camera(scene, &scene.cameras[settings.camera()], settings.emitters());
        self.follow_in(scene, settings, space)
    }

    /// As [`PreparedScene::follow`], in this render space.
    pub fn follow_in(&mut self, scene: &Scene, settings: &Settings, space: RenderSpace) -> Result<bool> {
        scene.check()?;
        let follows = space == self.space && self.follow_nearby(scene, settings)?;
        if follows {
            self.travel_time_bounds.take();
        }
        Ok(follows)
    }

    /// As [`PreparedScene::follow`], for previews: keeps the render space, so the image has other rounding errors than after a new
    /// preparation. Does not visit the triangles again, so it is fast in large scenes too, but the bounds on travel times become
    /// wider, and fewer paths are culled. Returns false and changes nothing if other lights emit, or if a light is infinitely far away.
    pub fn follow_nearby(&mut self, scene: &Scene, settings: &Settings) -> Result<bool> {
        scene.check_lights()?;
        let selected = settings.emitters();
        if self.emitters.has_distant {
            return Ok(false);
        }
        let emitters = EmitterSet::new(scene, selected, &self.space, &self.geometry, &self.solids);
        let is_like_before = emitters.densities == self.emitters.densities
            && emitters.table.len() == self.emitters.table.len()
            && emitters.deterministic.len() == self.emitters.deterministic.len()
            && emitters.thin_beams == self.emitters.thin_beams;
        if !is_like_before {
            return Ok(false);
        }
        self.velocities = velocities::table(scene, settings, &emitters, &self.space)?;
        let pairs = self.emitters.lights.iter().zip(&emitters.lights);
        let moved = pairs.map(|((a, _), (b, radius))| f64::from(a.distance(*b) + radius)).fold(0.0, f64::max);
        self.emitters = emitters;
        if let Some(bounds) = self.travel_time_bounds.get_mut() {
            *bounds = bounds.moved(moved * self.space.unit);
        }
        Ok(true)
    }

    /// Whether the camera may move to this place, in metres in world space, while the render space stays.
    pub fn reaches(&self, place: DVec3) -> bool {
        self.space.sensor(place).is_some()
    }

    /// Updates `self` after surfaces of [`Scene::moving`], lights without a surface, or the camera have moved. The rest of `scene` must be
    /// as before, and `settings` must select the same camera and emitters. Make a new renderer afterwards. Returns false and changes nothing
    /// if the render space changes. Also returns false if nothing emits; `self` has changed then.
    pub fn follow_surfaces(&mut self, scene: &Scene, settings: &Settings) -> Result<bool> {
        let space = RenderSpace::of_camera(scene, &scene.cameras[settings.camera()], settings.emitters());
        self.follow_surfaces_in(scene, settings, space)
    }

    /// As [`PreparedScene::follow_surfaces`], in this render space.
    pub fn follow_surfaces_in(&mut self, scene: &Scene, settings: &Settings, space: RenderSpace) -> Result<bool> {
        scene.check()?;
        null_boundary::check(scene)?;
        let camera = &scene.cameras[settings.camera()];
        if space != self.space {
            return Ok(false);
        }
        Arc::make_mut(&mut self.geometry).place(scene, &space);
        self.solids = Arc::new(Solids::new(&self.geometry));
        self.emitters = EmitterSet::new(scene, settings.emitters(), &space, &self.geometry, &self.solids);
        self.sensor = sensor(camera, settings, &space);
        self.aims = space.aims(camera);
        self.velocities = velocities::table(scene, settings, &self.emitters, &space)?;
        self.travel_time_bounds.take();
        Ok(!self.emitters.table.is_empty())
    }

    /// Aims the rays of another camera with [`crate::scene::Projection::Aimed`].
    pub fn aim(&mut self, camera: &Camera) {
        self.aims = self.space.aims(camera);
    }

    /// The render space of the scene.
    pub fn space(&self) -> RenderSpace {
        self.space
    }

    /// Bounds on the travel times of paths with at most `max_depth` segments, seen from the camera that the scene was prepared for.
    pub fn travel_time_bounds(&self, max_depth: u32) -> TravelTimeBounds {
        self.travel_time_bounds.get_or_init(|| TravelTimeBounds::new(self)).to_depth(max_depth)
    }

    /// Luminance-weighted power in W of every node that emits, by node name.
    pub fn powers(&self) -> &BTreeMap<String, f64> {
        &self.emitters.powers
    }

    /// Whether a light is infinitely far away, so that its light has no travel time.
    pub fn has_distant(&self) -> bool {
        self.emitters.has_distant
    }

    /// The settings and the scene without suns and skies; `None` if no other light is left.
    pub fn without_distant(scene: &Scene, settings: &Settings) -> Option<(Settings, PreparedScene)> {
        let distant = scene.lights.iter().filter(|light| light.kind.is_distant());
        let distant: HashSet<&str> = distant.map(|light| light.node.as_str()).collect();
        let nodes = scene.lights.iter().map(|light| &light.node).chain(scene.instances.iter().map(|i| &i.node));
        let others = nodes.filter(|node| settings.emitters().include(node) && !distant.contains(node.as_str()));
        let settings = settings.change().emitters(Emitters::Nodes(others.cloned().collect())).build().ok()?;
        let prepared = PreparedScene::new(scene, &settings).ok()?;
        Some((settings, prepared))
    }

    /// Warnings about a valid scene that will look wrong, one text each: [`PreparedScene::scene_warnings`] and [`missing_light`].
    pub fn warnings(&self, scene: &Scene, settings: &Settings) -> Vec<String> {
        let missing = missing_light(scene, settings, self).map(|missing| missing.describe());
        self.scene_warnings(scene, settings).into_iter().chain(missing).collect()
    }

    /// As [`missing_light`], for a scan with `count` points of the laser. Searches at some of them, and returns the one with the largest
    /// share of pixels. `at`: the laser, which is the last light of `scene`, and the camera while the laser looks at a point.
    pub fn missing_in_scan(
        &self,
        scene: &Scene,
        settings: &Settings,
        count: usize,
        at: impl Fn(usize) -> (Light, Camera),
    ) -> Option<(usize, MissingLight)> {
        let mut turned = scene.clone();
        let missing = (0..count).step_by(count.div_ceil(SEARCHED_POINTS).max(1)).filter_map(|point| {
            let (laser, camera) = at(point);
            *turned.lights.last_mut().expect("the laser is the last light") = laser;
            turned.cameras[settings.camera()] = camera;
            Some((point, missing_light(&turned, settings, self)?))
        });
        missing.max_by(|(_, a), (_, b)| a.share.total_cmp(&b.share))
    }

    /// Warnings that do not depend on the view. They are about copies of triangles, surfaces that are
    /// far too large, and objects that are far too distant. They also name a lamp at the pinhole in fog, lamps in the plane of another
    /// surface, and density grids that lose thin parts. Or they say that the search for the glass around lamps was stopped. Others name
    /// solids that are turned around, are nested, touch, or have an alpha below 1.
    pub fn scene_warnings(&self, scene: &Scene, settings: &Settings) -> Vec<String> {
        let copies = self.geometry.copies.map(|(count, instance)| {
            let node = &scene.instances[instance as usize].node;
            let triangles = if count == 1 { "triangle is a copy of another" } else { "triangles are copies of others" };
            format!(
                "{count} {triangles} with the same position and material; copies are ignored (the first is in node '{node}')"
            )
        });
        let PreparedScene { geometry, space, .. } = self;
        let oversized = oversized::warnings(scene, geometry, space);
        let far = far_objects::warnings(scene, geometry, space, self.powers());
        let unplaced = self.emitters.has_unplaced.then(|| UNPLACED.into());
        let at_pinhole = pinhole_in_fog::warning(scene, settings, space, self.sensor, self.powers());
        let coplanar = coplanar::warnings(scene, geometry, space);
        let warnings = copies.into_iter().chain(oversized).chain(far).chain(unplaced).chain(at_pinhole).chain(coplanar);
        let is_timed = !settings.responses().are_steady() || !self.media.list.is_empty();
        let of_glass = glass_checks::warnings(scene, geometry, &self.solids, space, is_timed);
        warnings.chain(grid::warnings(scene)).chain(of_glass).chain(sheets::warnings(scene)).collect()
    }

    /// Number of triangles over all instances, without copies.
    pub fn triangles(&self) -> usize {
        self.geometry.triangles.len()
    }
}

/// Points of the laser at which light is searched that no strategy forms.
const SEARCHED_POINTS: usize = 16;

/// Stores the seed of each pixel with its aimed ray, whose uncounted length is 0.
pub(super) fn set_seeds(aims: &mut [[f32; 4]], seeds: &[u32]) {
    assert_eq!(aims.len(), seeds.len(), "each beam has a seed");
    for (aim, &seed) in aims.iter_mut().zip(seeds) {
        aim[3] = f32::from_bits(seed);
    }
}

const UNPLACED: &str = "the search for the glass around lamps was stopped, because there are too many lamps and triangles of glass; some \
                        lamps count as being outside of glass; if they are inside, use fewer lamps, or glass with fewer triangles";

/// Bounding box, in render space, of the points where camera rays start.
fn sensor(camera: &Camera, settings: &Settings, space: &RenderSpace) -> Box3 {
    Box3::around(camera.corners(settings.resolution()).map(|corner| space.point(corner)))
}

/// Fails if a selected emitter does not exist. Also fails in two cases if a selected light is infinitely far away. In a gated render, its
/// light has no travel time. In a medium that fills all space, none of its light passes through.
fn check_emitters(scene: &Scene, settings: &Settings) -> Result<()> {
    let exists = |name: &String| {
        scene.lights.iter().any(|light| light.node == *name) || scene.instances.iter().any(|i| i.node == *name)
    };
    if let Emitters::Nodes(names) = settings.emitters()
        && let Some(unknown) = names.iter().find(|name| !exists(name))
    {
        return Err(Error::settings(format!(
            "the scene has no node '{unknown}', so it cannot be an emitter; check the name"
        )));
    }
    let distant = |light: &&Light| light.kind.is_distant() && settings.emitters().include(&light.node);
    match scene.lights.iter().find(distant) {
        Some(light) if !settings.responses().are_steady() => Err(Error::settings(format!(
            "the light '{}' is infinitely far away, so its light has no travel time to gate; render without a gate, or select \
             other emitters",
            light.node
        ))),
        Some(light) if scene.media.iter().any(Medium::is_unbounded) => Err(Error::settings(format!(
            "the light '{}' is infinitely far away, so none of its light passes through a medium that fills all space; give the \
             medium bounds, or select other emitters",
            light.node
        ))),
        _ => Ok(()),
    }
}
