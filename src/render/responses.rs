//! Several responses from one render: assigns each contribution to the responses by its travel time.
//!
//! The release profile does not optimise across codegen units. So what runs for each arrival is marked for inlining, and does without
//! `array::map` and adapters of iterators, whose closures would be calls (docs/notebook/long-histograms.md).

mod images;
pub mod on_device;
mod pixel_sums;
mod replaced;
mod weights;

use rayon::prelude::*;

use super::plan::Plan;
use crate::image::response_film::{FilmRow, ResponseFilm, rows};
pub use images::ResponseImages;
pub use on_device::{Adding, DeviceFilm};
use pixel_sums::PixelSums;
use replaced::{MAX_REPLACED, Notes, Replaced};
use weights::Weights;

/// Light that reaches the sensor. `Pixel` says how pixels are numbered: u32 is the row-major index in the crop.
#[derive(Debug, Clone, Copy)]
pub struct Arrival<Pixel = u32> {
    pub pixel: Pixel,
    /// Travel time in units of the render space.
    pub tau: f32,
    /// Contribution to the mean of the pixel in the present iteration.
    pub rgb: [f32; 3],
}

/// Index of a pixel among the pixels of its tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct IndexInTile(pub u32);

/// What is left of the images after an iteration that is not complete.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Undone {
    /// The images are those before the iteration.
    All,
    /// The device is lost. The images are those of the last copy ([`DeviceFilm::film`]).
    ToLastCopy,
    /// The images cannot be used.
    Nothing,
}

/// The images of several responses on the host, and the arrivals of the present iteration that are not in them yet.
pub struct ResponseSums {
    film: ResponseFilm,
    weights: Weights,
    /// The sum over all responses in the present iteration: R, G, B per pixel.
    total: Vec<f32>,
    /// The splats (t = 1) of the iteration, ordered by pixel.
    splats: Vec<Arrival>,
    /// Samples per pixel of the iteration, on average.
    samples: u32,
    /// Whether a part of the iteration is in the images.
    has_part: bool,
    replaced: Replaced,
}

impl ResponseSums {
    pub fn new(plan: &Plan, has_variance: bool) -> ResponseSums {
        let film = ResponseFilm::new(plan.image_pixels as usize, plan.responses.len(), has_variance);
        ResponseSums::with(film, Weights::new(&plan.responses, &plan.space))
    }

    fn with(film: ResponseFilm, weights: Weights) -> ResponseSums {
        let replaced = Replaced::new(MAX_REPLACED);
        ResponseSums { film, weights, total: vec![], splats: vec![], samples: 0, has_part: false, replaced }
    }

    pub fn film(&self) -> &ResponseFilm {
        &self.film
    }

    /// Ends an iteration that is not complete: the images become those before it. Returns false if too much was replaced in them; they
    /// cannot be used then.
    pub fn restore(&mut self) -> bool {
        let can_restore = !self.has_part || self.replaced.put_back(&mut self.film);
        self.has_part = !can_restore;
        can_restore
    }

    /// Goes on from the images of earlier iterations.
    pub fn resume(&mut self, film: ResponseFilm) {
        self.film = film;
    }

    /// Goes on in another scene with the same responses.
    pub fn follow(&mut self, plan: &Plan) {
        self.weights = Weights::new(&plan.responses, &plan.space);
    }

    /// Turns the phases of a heterodyne sensor.
    pub fn turn_waves(&mut self, turns: f64) {
        self.weights.turn_waves(turns);
    }

    /// Begins an iteration with `samples` samples per pixel on average.
    pub fn begin(&mut self, samples: u32) {
        self.samples = samples;
        self.replaced.clear();
        self.total.clear();
        self.total.resize(3 * self.film.pixels(), 0.0);
    }

    /// Takes the splats of the pixels that are added next.
    pub fn set_splats(&mut self, mut splats: Vec<Arrival>) {
        splats.par_sort_by_key(|splat| splat.pixel);
        self.splats = splats;
    }

    /// Adds all light of the `pixels` of a tile: their splats, and `arrivals` from sensor subpaths. Each pixel is added only once per
    /// iteration. The pixels of `arrivals` ascend again and again, bounce by bounce. The order of the arrivals of a pixel decides the last
    /// bits of its sums.
    pub fn add(&mut self, pixels: &[u32], arrivals: &[Vec<Arrival<IndexInTile>>]) {
        self.has_part = true;
        let ResponseSums { film, weights, total, splats, samples, replaced, .. } = self;
        let notes = replaced.take_spare(pixels.len().div_ceil(BLOCK));
        let runs = arrivals.par_iter().flat_map_iter(|part| part.chunk_by(|a, b| a.pixel <= b.pixel)).collect();
        let light = Light { weights, splats, runs, samples: *samples, replaced };
        let mut places = places(film, total, pixels);
        let blocks = places.par_chunks_mut(BLOCK).zip(notes).enumerate();
        let new_sums = || PixelSums::new(light.weights.count());
        let add = |sums: &mut PixelSums, (block, (places, notes))| light.add_to(block * BLOCK, places, sums, notes);
        let notes = blocks.map_init(new_sums, add).collect();
        self.replaced.keep(notes);
    }

    /// Ends the iteration. Returns the sum over all responses of its images: R, G, B per pixel.
    pub fn end(&mut self) -> Vec<f32> {
        self.splats.clear();
        self.film.end_iteration(self.samples);
        self.has_part = false;
        std::mem::take(&mut self.total)
    }
}

/// Number of pixels to which a thread adds light in one go.
const BLOCK: usize = 32;

/// Where the light of a pixel belongs.
struct Place<'a> {
    /// Row-major index in the crop.
    pixel: u32,
    row: FilmRow<'a>,
    total: &'a mut [f32],
}

/// The places of `pixels`, in the same order.
fn places<'a>(film: &'a mut ResponseFilm, total: &'a mut [f32], pixels: &[u32]) -> Vec<Place<'a>> {
    let mut order: Vec<u32> = (0..pixels.len() as u32).collect();
    order.par_sort_unstable_by_key(|&index| pixels[index as usize]);
    let ascending = order.iter().map(|&index| pixels[index as usize]);
    let rows = film.rows_mut(ascending.clone()).zip(rows(total, 3, ascending.clone()));
    let mut places: Vec<Option<Place>> = pixels.iter().map(|_| None).collect();
    for ((&index, pixel), (row, total)) in order.iter().zip(ascending).zip(rows) {
        places[index as usize] = Some(Place { pixel, row, total });
    }
    // Collects into the memory of the options.
    places.into_iter().map(|place| place.expect("each index is in the order once")).collect()
}

/// Light that is to be added to the images.
struct Light<'a> {
    weights: &'a Weights,
    splats: &'a [Arrival],
    /// In each run, the pixels ascend.
    runs: Vec<&'a [Arrival<IndexInTile>]>,
    samples: u32,
    replaced: &'a Replaced,
}

impl Light<'_> {
    /// Adds the light of the pixels at `places`, which begin with pixel `first` of the tile. Returns what this replaces, in the
    /// memory of `notes`.
    fn add_to(&self, first: usize, places: &mut [Place], sums: &mut PixelSums, mut notes: Notes) -> Notes {
        let has_notes = !self.replaced.is_too_much();
        let begin_of = |run: &[Arrival<IndexInTile>], index: usize| {
            run.partition_point(|arrival| arrival.pixel < IndexInTile(index as u32))
        };
        let runs = self.runs.iter().map(|run| &run[begin_of(run, first)..begin_of(run, first + places.len())]);
        let mut runs: Vec<&[Arrival<IndexInTile>]> = runs.filter(|run| !run.is_empty()).collect();
        for (place, index) in places.iter_mut().zip((first as u32..).map(IndexInTile)) {
            sums.clear();
            self.splats_of(place.pixel).iter().for_each(|splat| sums.add(self.weights, splat));
            for run in &mut runs {
                while let Some((arrival, rest)) = run.split_first()
                    && arrival.pixel == index
                {
                    sums.add(self.weights, arrival);
                    *run = rest;
                }
            }
            let mut total = [0.0; 3];
            sums.visit(|response, rgb| {
                total = [total[0] + rgb[0], total[1] + rgb[1], total[2] + rgb[2]];
                if has_notes {
                    notes.add(place.pixel, response, &place.row);
                }
                place.row.add(response, rgb, self.samples);
            });
            place.total.copy_from_slice(&total.map(|x| x as f32));
        }
        self.replaced.admit(notes)
    }

    fn splats_of(&self, pixel: u32) -> &[Arrival] {
        let begin = self.splats.partition_point(|splat| splat.pixel < pixel);
        let count = self.splats[begin..].iter().take_while(|splat| splat.pixel == pixel).count();
        &self.splats[begin..begin + count]
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use glam::DVec3;

    use super::weights::tests::gates;
    use super::*;
    use crate::render::space::RenderSpace;
    use crate::scene::Scene;
    use crate::settings::{Edge, Emitters, Responses};

    /// Number of pixels. Their order in tiles is not that in the crop.
    const PIXELS: u32 = 200;

    /// The arrivals of two bounces in the pixels of a tile. `begin` is the number of the tile's first pixel, counted over all tiles.
    fn arrivals(begin: u32, pixels: &[u32]) -> Vec<Vec<Arrival<IndexInTile>>> {
        let of_bounce = |bounce: u32| {
            let numbers = (begin..).zip(0..pixels.len() as u32).filter(|(number, _)| number % 5 != bounce);
            let of_pixel = |(number, index): (u32, u32)| {
                (0..number % 40).map(move |i| {
                    let x = (0.618_034 * f64::from(1 + number * 977 + i * 31 + bounce)).fract() as f32;
                    Arrival { pixel: IndexInTile(index), tau: 3.9 + 9.0 * x, rgb: [x, 1.0 / (x + 1e-3), 1e6 * x * x] }
                })
            };
            numbers.flat_map(of_pixel).collect()
        };
        (0..2).map(of_bounce).collect()
    }

    #[test]
    fn sums_depend_neither_on_tiles_nor_on_parts() {
        let space = RenderSpace::new(&Scene::default(), DVec3::ZERO, &Emitters::Scene);
        let order: Vec<u32> = (0..PIXELS).map(|i| i * 77 % PIXELS).collect();
        let splats = || order.iter().map(|&pixel| Arrival { pixel, tau: 5.0, rgb: [0.3, 1e-9, 7.0] }).step_by(3);
        for edge in [Edge::Sharp, Edge::Gauss(0.3)] {
            let weights = || Weights::new(&Responses::new(gates(70, 0.1, edge)).unwrap(), &space);
            let new = || ResponseSums::with(ResponseFilm::new(PIXELS as usize, 70, true), weights());
            let light_of = |sums: &mut ResponseSums| {
                let film = &mut sums.film;
                (0..PIXELS * 70).map(|i| film.row_mut(i / 70).sums_of(i % 70)).collect::<Vec<_>>()
            };

            // One pixel and one arrival at a time.
            let mut wanted = new();
            let (all, weights) = (arrivals(0, &order), weights());
            let in_crop =
                all.iter().flatten().map(|a| Arrival { pixel: order[a.pixel.0 as usize], tau: a.tau, rgb: a.rgb });
            let mut per_pixel = BTreeMap::<(u32, u32), [f64; 3]>::new();
            for arrival in splats().chain(in_crop) {
                weights.visit(arrival.tau, |response, weight| {
                    let term = arrival.rgb.map(|x| f64::from(x) * weight);
                    let sum = per_pixel.entry((arrival.pixel, response)).or_default();
                    (0..3).for_each(|k| sum[k] += term[k]);
                });
            }
            per_pixel.iter().for_each(|(&(pixel, response), &rgb)| wanted.film.row_mut(pixel).add(response, rgb, 3));
            let wanted = light_of(&mut wanted);
            let count = wanted.iter().filter(|(sums, _)| sums[0] > 0.0).count();
            assert!(count > 1000, "{count} sums");

            for (pixels_per_tile, length_of_part) in [(200, usize::MAX), (64, 100), (7, 1)] {
                let add_all = |sums: &mut ResponseSums| {
                    sums.begin(3);
                    sums.set_splats(splats().collect());
                    for (tile, begin) in order.chunks(pixels_per_tile).zip((0..).step_by(pixels_per_tile)) {
                        let all = arrivals(begin, tile);
                        let parts: Vec<Vec<_>> =
                            all.iter().flat_map(|run| run.chunks(length_of_part).map(<[_]>::to_vec)).collect();
                        sums.add(tile, &parts);
                    }
                    assert!(light_of(sums) == wanted, "{edge:?}, {pixels_per_tile} pixels per tile");
                    let total: f64 = per_pixel.range((9, 0)..(10, 0)).map(|(_, rgb)| rgb[1]).sum();
                    assert_eq!(sums.total[3 * 9 + 1], total as f32);
                };
                // The limit equals the number of changes; then it is one too small; then the first block already exceeds it.
                let changes = per_pixel.len();
                for (limit, can_restore) in [(changes, true), (changes - 1, false), (1, false)] {
                    let mut sums = new();
                    sums.replaced = Replaced::new(limit);
                    let black = light_of(&mut sums);
                    add_all(&mut sums);
                    assert_eq!(sums.restore(), can_restore, "{limit} of {changes} changes");
                    if can_restore {
                        assert!(light_of(&mut sums) == black);
                        add_all(&mut sums);
                    }
                    assert!(light_of(&mut sums) == wanted);
                    // A complete iteration is not undone.
                    sums.end();
                    assert!(sums.restore() && light_of(&mut sums) == wanted);
                }
            }
        }
    }
}
