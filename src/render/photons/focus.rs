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
/// Photons over those of useful pieces, from pieces whose light can be scattered towards what the camera sees. Fewer if these pieces receive
/// less light.
const FACING: f64 = 0.25;
/// The same for all other pieces, because the search may miss light.
const OTHERS: f64 = 1.0 / 9.0;
/// Pieces are tested against this many places that the camera sees.
const FACED: usize = 64;

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
    let mut open: Vec<(Piece, f64)> = all().collect();
    let (mut useful, mut facing, mut others) = (vec![], vec![], vec![]);
    for round in 0..=MAX_ROUNDS {
        let found: Vec<Reached> = open.par_iter().map(|(piece, _)| reached(world, source, piece, &seen)).collect();
        let mut coarse = vec![];
        for ((piece, weight), found) in open.drain(..).zip(found) {
            match found {
                Reached::Seen(size) if source.size(&piece) <= size || round == MAX_ROUNDS => {
                    useful.push((piece, weight))
                }
                Reached::Seen(_) => coarse.push((piece, weight)),
                Reached::Facing => facing.push((piece, weight)),
                Reached::Others => others.push((piece, weight)),
            }
        }
        let quarters: Vec<_> = coarse.iter().flat_map(|(piece, _)| source.quarters(piece)).collect();
        if useful.len() + facing.len() + others.len() + quarters.len() > MAX_PIECES {
            useful.append(&mut coarse);
            break;
        }
        open = quarters;
        if open.is_empty() {
            break;
        }
    }
    shared(useful, facing, others).unwrap_or(aims)
}

/// Pieces with their weights, those of `facing` and `others` reduced to their shares. `None` if no piece is useful.
fn shared(useful: Vec<(Piece, f64)>, facing: Vec<(Piece, f64)>, others: Vec<(Piece, f64)>) -> Option<Aims> {
    let sum = |pieces: &[(Piece, f64)]| pieces.iter().map(|(_, weight)| weight).sum::<f64>();
    let of_useful = sum(&useful);
    if of_useful <= 0.0 {
        return None;
    }
    let mut aims = Aims::default();
    useful.into_iter().for_each(|(piece, weight)| aims.push(piece, weight));
    for (pieces, share) in [(facing, FACING), (others, OTHERS)] {
        let factor = (share * of_useful / sum(&pieces)).min(1.0);
        pieces.into_iter().for_each(|(piece, weight)| aims.push(piece, factor * weight));
    }
    Some(aims)
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

/// Where the photons of a piece arrive.
enum Reached {
    /// At places that the camera sees: the largest size at which the piece need not be divided.
    Seen(f64),
    /// In sight of such places, if nothing is between.
    Facing,
    Others,
}

/// Whether light that an event scatters may reach `seen`, if nothing is between.
fn is_facing(event: &Event, seen: &Seen) -> bool {
    let way = seen.place - event.path.origin;
    let is_before =
        |normal: Option<DVec3>, way: DVec3| normal.is_none_or(|normal| normal.dot(way) > 0.1 * way.length());
    is_before(event.normal, way) && is_before(seen.normal, -way)
}

/// Follows a few photons of `piece`.
fn reached(world: &World, source: &PhotonSource, piece: &Piece, seen: &[Seen]) -> Reached {
    let size = source.size(piece);
    let (mut wanted, mut faces) = (None::<f64>, false);
    for ray in (0..PILOTS).filter_map(|number| source.pilot(piece, number)) {
        world.walk(ray, &mut |event: Event| {
            if event.path.smooth == 0 && !piece.is_beam() {
                return;
            }
            faces |= seen.iter().step_by(seen.len().div_ceil(FACED)).any(|seen| is_facing(&event, seen));
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
    match wanted {
        Some(size) => Reached::Seen(size),
        None if faces => Reached::Facing,
        None => Reached::Others,
    }
}

#[cfg(test)]
mod tests {
    use super::super::aims::Target;
    use super::*;

    #[test]
    fn pieces_that_the_camera_does_not_see_get_their_shares_or_less() {
        let pieces = |weights: &[f64]| {
            let piece = |&weight: &f64| (Piece { emitter: 0, target: Target::Beam }, weight);
            weights.iter().map(piece).collect::<Vec<_>>()
        };
        let weights = |useful: &[f64], facing: &[f64], others: &[f64]| {
            let aims = shared(pieces(useful), pieces(facing), pieces(others))?;
            Some(aims.piece_weights().map(|weight| (1e6 * weight).round() / 1e6).collect::<Vec<_>>())
        };
        assert_eq!(weights(&[10.0, 8.0], &[30.0, 60.0], &[200.0]), Some(vec![10.0, 8.0, 1.5, 3.0, 2.0]));
        assert_eq!(weights(&[18.0], &[1.0], &[0.5]), Some(vec![18.0, 1.0, 0.5]));
        assert_eq!(weights(&[18.0], &[], &[]), Some(vec![18.0]));
        assert_eq!(weights(&[], &[1.0], &[1.0]), None);
    }

    /// Two walls that face each other, two parts of one wall, and a medium.
    #[test]
    fn surfaces_face_each_other_if_both_see_the_other_one() {
        let event = |normal| Event { path: Ray::start(DVec3::ZERO, DVec3::X, 0), arriving: 1.0, normal };
        let seen = |place, normal| Seen { place, normal, spacing: 0.1 };
        let (left, right) = (Some(DVec3::X), Some(DVec3::NEG_X));
        assert!(is_facing(&event(left), &seen(DVec3::new(2.0, 1.0, 0.0), right)));
        assert!(!is_facing(&event(right), &seen(DVec3::new(2.0, 1.0, 0.0), right)));
        assert!(!is_facing(&event(left), &seen(DVec3::new(2.0, 1.0, 0.0), left)));
        assert!(!is_facing(&event(left), &seen(DVec3::Y, left)));
        assert!(is_facing(&event(None), &seen(DVec3::Y, None)) && is_facing(&event(left), &seen(DVec3::X, None)));
    }
}
