//! Renders variants in turns, so that other load on the machine slows all of them equally.

use super::case::{Case, Entry};
use super::reference::Reference;
use super::table::Row;
use super::timed_renderer::TimedRenderer;
use crate::compare::flip;
use crate::compare::metrics::{self, Means};
use crate::error::Result;
use crate::gpu::Device;
use crate::image::film::Film;
use crate::render::PreparedScene;
use crate::scene::{Scene, optical_thickness};

/// Number of time points of a race. Each time is twice the one before; the last is the whole time.
pub const POINTS: u32 = 7;
/// Number of turns of a renderer within the whole time; fewer if one iteration takes longer than a turn.
const TURNS: f64 = 64.0;

/// The times in seconds at which the error is measured.
pub fn points(seconds: f64) -> Vec<f64> {
    (0..POINTS).rev().map(|k| seconds / f64::from(1u32 << k)).collect()
}

/// Renderers for all variants of a scene, with compiled kernels.
pub struct Race<'a> {
    case: &'a Case,
    timed_renderers: Vec<TimedRenderer>,
    references: Vec<Option<Reference>>,
}

impl<'a> Race<'a> {
    /// `references`: one per entry of the case, with the size of its crop; `None` if only costs are measured.
    pub fn new(
        device: &Device,
        case: &'a Case,
        prepared: &PreparedScene,
        references: Vec<Option<Reference>>,
    ) -> Result<Race<'a>> {
        let timed = |entry: &Entry| TimedRenderer::new(device, &case.scene, &entry.settings, prepared);
        Ok(Race { timed_renderers: case.entries.iter().map(timed).collect::<Result<_>>()?, case, references })
    }

    /// One repetition: every variant renders until the end of the iteration nearest to `seconds`. `watch` is called after each turn
    /// with the seconds of that turn, and returns whether to continue. Returns the rows, at most one per variant and time point, or
    /// `None` if `watch` stopped the work.
    pub fn run(
        &mut self,
        repetition: u32,
        seconds: f64,
        watch: &mut dyn FnMut(f64) -> bool,
    ) -> Result<Option<Vec<Row>>> {
        let points = points(seconds);
        let mut next = vec![0; self.timed_renderers.len()];
        let mut rows = vec![];
        self.timed_renderers.iter_mut().for_each(|timed| timed.restart(seed(repetition)));
        // The renderer with the least time so far has the next turn.
        while let Some(at) = next_to_run(&self.timed_renderers, &next, points.len()) {
            let timed = &mut self.timed_renderers[at];
            let begin = timed.clock;
            timed.run_until((begin + seconds / TURNS).min(points[next[at]]))?;
            let spent = timed.clock - begin;
            let reached = points.iter().filter(|&&point| timed.has_reached(point)).count();
            if reached > next[at] {
                next[at] = reached;
                rows.push(self.measure(at, repetition, reached as u32 - 1)?);
            }
            if !watch(spent) {
                return Ok(None);
            }
        }
        rows.sort_by_key(|row| self.case.entries.iter().position(|entry| entry.variant == row.variant));
        Ok(Some(rows))
    }

    fn measure(&self, at: usize, repetition: u32, point: u32) -> Result<Row> {
        let (timed, entry) = (&self.timed_renderers[at], &self.case.entries[at]);
        let (relmse, own, flip) = match &self.references[at] {
            None => (Means::NAN, Means::NAN, f64::NAN),
            Some(Reference { picture, own, .. }) => {
                let image = timed.renderer.film().shown();
                let errors = metrics::compare(&image, &picture.rgb)?;
                let relmse = Means { all: errors.relmse, trimmed: errors.trimmed_relmse };
                (relmse, *own, flip::hdr(&image, &picture.rgb, picture.width as usize).mean())
            }
        };
        let (crop, gate) = (entry.settings.crop(), entry.settings.responses().support());
        let (pixels, samples) = (u64::from(crop.width()) * u64::from(crop.height()), timed.renderer.film().samples());
        let queries = timed.count(|s| s.candidates);
        let vertices = timed.count(|s| s.emitter_vertices + s.scattered_vertices + s.deterministic_vertices);
        Ok(Row {
            scene: self.case.name.clone(),
            variant: entry.variant.clone(),
            estimator: entry.settings.estimator().to_string(),
            repetition,
            point,
            seconds: timed.clock,
            samples,
            relmse,
            own,
            flip,
            dropped: timed.count(|s| s.dropped),
            light_vertices: vertices as f64 / timed.count(|s| s.iterations) as f64,
            queries_per_s: queries as f64 / timed.clock,
            rays_per_s: timed.count(|s| s.rays()) as f64 / timed.clock,
            dead_query_share: 1.0 - timed.count(|s| s.live_candidates) as f64 / (queries as f64).max(1.0),
            triangles: timed.renderer.stats().triangles,
            pixels,
            gate_m: gate.hi - gate.lo,
            optical_thickness: thickness(&self.case.scene),
            us_per_sample: 1e6 * timed.clock / (samples * pixels) as f64,
            fingerprint: entry.fingerprint.clone(),
        })
    }

    /// For every variant: its entry, its film of the last repetition, and the seconds of rendering.
    pub fn films(&self) -> impl Iterator<Item = (&Entry, &Film, f64)> {
        self.case
            .entries
            .iter()
            .zip(&self.timed_renderers)
            .map(|(entry, timed)| (entry, timed.renderer.film(), timed.clock))
    }
}

/// Optical thickness along the scene's diagonal, averaged over the channels; 0 if the scene has no bounds.
fn thickness(scene: &Scene) -> f64 {
    scene.bounds().map_or(0.0, |[lo, hi]| {
        let across = hi - lo;
        optical_thickness(&scene.media, lo, across.normalize_or_zero(), across.length()).iter().sum::<f64>() / 3.0
    })
}

fn next_to_run(timed_renderers: &[TimedRenderer], next: &[usize], points: usize) -> Option<usize> {
    let open = (0..timed_renderers.len()).filter(|&i| next[i] < points);
    open.min_by(|&a, &b| timed_renderers[a].clock.total_cmp(&timed_renderers[b].clock))
}

/// Seed of a repetition. References use other seeds.
pub fn seed(repetition: u32) -> u32 {
    1 + repetition
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Kind, build};
    use crate::scene::Medium;

    #[test]
    fn thickness_is_that_of_the_diagonal() {
        let mut scene = build(Kind::CornellBox);
        assert_eq!(thickness(&scene), 0.0);
        scene.media = vec![Medium { sigma_s: [0.1, 0.2, 0.3], sigma_a: [0.1; 3], ..Medium::default() }];
        assert!((thickness(&scene) / scene.diagonal() - 0.3).abs() < 1e-6);
        assert_eq!(thickness(&Scene::default()), 0.0);
    }
}
