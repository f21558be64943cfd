//! Sends most photons to places that the camera sees. A search on the host follows camera rays over smooth surfaces to the first event
//! that is not smooth, and a few photons of each piece to theirs. Pieces whose photons arrive near what the camera sees are divided
//! further. The search only chooses densities: whatever it finds, the mean of the image is the same.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::aims::{Aims, MAX_PIECES, Piece};
use super::source::PhotonSource;
use crate::render::missing_light::walk::{Event, Ray, World};
use crate::render::plan::Plan;
use crate::wgsl::layout::Frame;

/// Camera rays along each side of the crop.
const SIDE: u32 = 32;
/// Photons of a piece in the search.
const PILOTS: u32 = 4;
/// A piece is useful if a photon arrives within this many sizes of the piece, as seen from the lamp and at the distance of the photon.
const REACH: f64 = 1.0;
/// A piece is divided while its size is more than this many distances between camera rays.
const COARSE: f64 = 1.5;
/// Maximum number of rounds, each of which halves the size of useful pieces.
const MAX_ROUNDS: u32 = 12;
/// The least share of the photons that start from all other pieces, because the search may miss light.
const OTHERS: f64 = 0.1;

/// The distance between places in a medium, over the length of the camera's path.
const MEDIUM_SPACING: f64 = 0.25;

/// A place that the camera sees, and the distance to its neighbours.
struct Seen {
    place: DVec3,
    /// `None` in a medium.
    normal: Option<DVec3>,
    spacing: f64,
}

/// Divides the useful pieces, and gives them most of the photons. `rays`: see [`camera_rays`]. Changes nothing if no piece is useful.
/// Stops where there would be too many pieces.
pub fn focus(aims: Aims, source: &PhotonSource, plan: &Plan, world: &World, rays: &[(Ray, f64)]) -> Aims {
    let seen = seen(world, plan, rays);
    if seen.is_empty() {
        return aims;
    }
    let all = || aims.pieces.iter().zip(aims.piece_weights()).map(|(piece, weight)| (*piece, weight));
    let (mut open, mut useful, mut others): (Vec<(Piece, f64)>, Vec<_>, Vec<_>) = (all().collect(), vec![], vec![]);
    for round in 0..=MAX_ROUNDS {
        // For each open piece, the largest size at which it need not be divided; `None` if it is not useful.
        let found: Vec<Option<f64>> = open.par_iter().map(|(piece, _)| nearest(world, source, piece, &seen)).collect();
        let mut coarse = vec![];
        for ((piece, weight), found) in open.drain(..).zip(found) {
            match found {
                None => others.push((piece, weight)),
                Some(size) if source.size(&piece) <= size || round == MAX_ROUNDS => useful.push((piece, weight)),
                Some(_) => coarse.push((piece, weight)),
            }
        }
        let quarters: Vec<_> = coarse.iter().flat_map(|(piece, _)| source.quarters(piece)).collect();
        if useful.len() + others.len() + quarters.len() > MAX_PIECES {
            useful.append(&mut coarse);
            break;
        }
        open = quarters;
        if open.is_empty() {
            break;
        }
    }
    let sum = |pieces: &[(Piece, f64)]| pieces.iter().map(|(_, weight)| weight).sum::<f64>();
    let (of_useful, of_others) = (sum(&useful), sum(&others));
    if of_useful <= 0.0 {
        return aims;
    }
    let factor = (OTHERS / (1.0 - OTHERS) * of_useful / of_others).min(1.0);
    let mut focused = Aims::default();
    useful.into_iter().for_each(|(piece, weight)| focused.push(piece, weight));
    others.into_iter().for_each(|(piece, weight)| focused.push(piece, factor * weight));
    focused
}

/// The first events that are not smooth on the camera rays, sorted by x.
fn seen(world: &World, plan: &Plan, rays: &[(Ray, f64)]) -> Vec<Seen> {
    let first = |&(ray, spacing): &(Ray, f64)| {
        let mut seen = vec![];
        world.walk(ray, &mut |event: Event| {
            let is_gathered = event.path.smooth > 0 || !plan.splats;
            if is_gathered {
                let spread = if plan.is_orthographic() { 1.0 } else { event.path.length };
                let spacing = match event.normal {
                    Some(_) => spacing * spread,
                    None => MEDIUM_SPACING * event.path.length,
                };
                seen.push(Seen { place: event.path.origin, normal: event.normal, spacing });
            }
        });
        seen
    };
    let mut seen: Vec<Seen> = rays.par_iter().flat_map_iter(first).collect();
    seen.sort_by(|a, b| a.place.x.total_cmp(&b.place.x));
    seen
}

/// SIDE^2 evenly spaced camera rays, each with the distance to its neighbours at distance 1; with an orthographic camera at any distance.
/// `aims`: rays of pixels that look at points of their own. At most SIDE^2 of them are returned, with the width of a pixel.
pub fn camera_rays(plan: &Plan, aims: &[[f32; 4]]) -> Vec<(Ray, f64)> {
    let frame = plan.camera_frame();
    if aims.is_empty() {
        return (0..SIDE * SIDE).map(|number| camera_ray(frame, plan, number)).collect();
    }
    let sensor = DVec3::from(frame.sensor.map(f64::from));
    let few = aims.iter().step_by(aims.len().div_ceil((SIDE * SIDE) as usize));
    let ray = |&[x, y, z, _]: &[f32; 4]| {
        let direction = DVec3::from([x, y, z].map(f64::from)).normalize_or_zero();
        (Ray::start(sensor, direction, frame.sensor_solid), plan.pixel_width())
    };
    few.map(ray).collect()
}

/// Camera ray `number` of SIDE^2, and the distance to its neighbours.
fn camera_ray(frame: &Frame, plan: &Plan, number: u32) -> (Ray, f64) {
    let at =
        |k: u32, first: u32, size: u32| f64::from(first) + (f64::from(k) + 0.5) / f64::from(SIDE) * f64::from(size);
    let film = [at(number % SIDE, frame.crop_x, frame.crop_width), at(number / SIDE, frame.crop_y, frame.crop_height)];
    let size = [frame.width, frame.height].map(f64::from);
    let extent = frame.extent.map(f64::from);
    let x = (2.0 * (film[0] - f64::from(frame.principal_offset[0])) / size[0] - 1.0) * extent[0];
    let y = (1.0 - 2.0 * (film[1] - f64::from(frame.principal_offset[1])) / size[1]) * extent[1];
    let [right, up, forward, sensor] =
        [frame.right, frame.up, frame.forward, frame.sensor].map(|v| DVec3::from(v.map(f64::from)));
    let aside = x * right + y * up;
    let (origin, direction) = match plan.is_orthographic() {
        true => (sensor + aside, forward),
        false => {
            let to = plan.distortion.direction(DVec2::new(x, -y));
            (sensor, (to.x * right - to.y * up + to.z * forward).normalize())
        }
    };
    let crop = [f64::from(frame.crop_width) / size[0] * extent[0], f64::from(frame.crop_height) / size[1] * extent[1]];
    let spacing = 2.0 * crop[0].max(crop[1]) / f64::from(SIDE);
    (Ray::start(origin, direction, frame.sensor_solid), spacing)
}

/// Whether a surface with normal `a` may gather photons from one with normal `b`; or a medium from a medium.
fn is_alike(a: Option<DVec3>, b: Option<DVec3>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => a.dot(b) > 0.5,
        (a, b) => a.is_none() && b.is_none(),
    }
}

/// The size of pieces that suits the light which photons of `piece` bring to places that the camera sees. `None` if they bring none.
fn nearest(world: &World, source: &PhotonSource, piece: &Piece, seen: &[Seen]) -> Option<f64> {
    let size = source.size(piece);
    let mut wanted = None::<f64>;
    for ray in (0..PILOTS).filter_map(|number| source.pilot(piece, number)) {
        world.walk(ray, &mut |event: Event| {
            if event.path.smooth == 0 && !piece.is_beam() {
                return;
            }
            let spread = if source.is_parallel(piece) { 1.0 } else { event.path.length };
            let (place, reach) = (event.path.origin, REACH * size * spread);
            let first = seen.partition_point(|seen| seen.place.x < place.x - 2.0 * reach);
            // Places that are far apart are found from far away, too.
            let near = seen[first..].iter().take_while(|seen| seen.place.x <= place.x + 2.0 * reach);
            for seen in near {
                let limit = reach + seen.spacing;
                if seen.place.distance_squared(place) <= limit * limit && is_alike(seen.normal, event.normal) {
                    let suits = COARSE * seen.spacing / spread;
                    wanted = Some(wanted.map_or(suits, |before| before.min(suits)));
                }
            }
        });
    }
    wanted
}
