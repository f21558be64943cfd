//! The light that the search finds, and what of it is missing.

use std::collections::BTreeMap;

use super::Search;
use super::message::MissingLight;
use crate::scene::Scene;

/// A pixel is affected if it misses more than the first share of its light, and more than the second share of the brightest pixel.
const MIN_MISSED: f64 = 0.02;
const MIN_BRIGHTNESS: f64 = 1e-3;

/// Light of one pixel, formed and missing.
#[derive(Default, Clone)]
pub struct Pixel {
    formed: f64,
    missing: f64,
    /// Part of `missing` whose smooth surfaces are on both sides of the scattering event.
    on_both_sides: f64,
    /// Part of `missing` whose paths have more than max_depth segments.
    too_long: f64,
    /// Part of `missing` that thin glass reflects before any other smooth surface meets it.
    by_sheets: f64,
    /// Whether merging finds a part of `formed`.
    pub is_merged: bool,
}

/// Light of a lamp at an event, times the share of the event.
pub struct Contribution {
    pub light: f64,
    /// Travel time in metres.
    pub tau: f64,
    pub is_missing: bool,
    /// Whether only merging finds the light.
    pub is_merged: bool,
    pub on_both_sides: bool,
    pub is_too_long: bool,
    pub is_by_sheet: bool,
    pub lamp: usize,
    pub object: Option<u32>,
}

/// What the search has found so far.
pub struct Found {
    pub pixels: Vec<Pixel>,
    /// Missing light by lamp and by instance.
    lamps: Vec<f64>,
    objects: BTreeMap<u32, f64>,
    /// Travel times in metres and light that only merging finds.
    pub merged: Vec<(f64, f64)>,
}

impl Found {
    /// Nothing yet, for so many lamps.
    pub fn new(lamps: usize) -> Found {
        Found { pixels: vec![], lamps: vec![0.0; lamps], objects: BTreeMap::new(), merged: vec![] }
    }

    pub fn add(&mut self, pixel: usize, contribution: Contribution) {
        let Contribution { light, tau, is_missing, is_merged, on_both_sides, is_too_long, is_by_sheet, lamp, object } =
            contribution;
        if is_merged {
            self.merged.push((tau, light));
        }
        let pixel = &mut self.pixels[pixel];
        pixel.is_merged |= is_merged;
        if !is_missing {
            pixel.formed += light;
            return;
        }
        pixel.missing += light;
        pixel.on_both_sides += if on_both_sides { light } else { 0.0 };
        pixel.too_long += if is_too_long { light } else { 0.0 };
        pixel.by_sheets += if is_by_sheet { light } else { 0.0 };
        self.lamps[lamp] += light;
        if let Some(object) = object {
            *self.objects.entry(object).or_default() += light;
        }
    }

    /// `None` if no pixel misses enough light to be told.
    pub fn summary(&self, scene: &Scene, search: &Search) -> Option<MissingLight> {
        let brightest = self.pixels.iter().map(|pixel| pixel.formed + pixel.missing).fold(0.0, f64::max);
        let affected: Vec<&Pixel> = self.pixels.iter().filter(|pixel| pixel.is_affected(brightest)).collect();
        if affected.is_empty() {
            return None;
        }
        let lamp = (0..self.lamps.len()).max_by(|&a, &b| self.lamps[a].total_cmp(&self.lamps[b]))?;
        let object = self.objects.iter().max_by(|a, b| a.1.total_cmp(b.1)).map(|(instance, _)| *instance);
        let object = object.map_or(String::new(), |instance| scene.instances[instance as usize].node.clone());
        let sum = |of: fn(&Pixel) -> f64| affected.iter().map(|pixel| of(pixel)).sum::<f64>();
        Some(MissingLight {
            loss: sum(|pixel| pixel.missing) / sum(|pixel| pixel.missing + pixel.formed),
            share: affected.len() as f64 / self.pixels.len() as f64,
            lamp: search.lamps[lamp].light.node.clone(),
            object,
            too_long: sum(|pixel| pixel.too_long) > 0.5 * sum(|pixel| pixel.missing),
            by_sheets: sum(|pixel| pixel.by_sheets) > 0.5 * sum(|pixel| pixel.missing),
            has_remedy: search.may_connect_camera,
            is_switched_off: search.is_switched_off,
            only_before: affected.iter().all(|pixel| pixel.on_both_sides <= MIN_MISSED * pixel.missing),
        })
    }
}

impl Pixel {
    /// Whether the pixel misses enough light to be told. `brightest`: light of the brightest pixel.
    pub fn is_affected(&self, brightest: f64) -> bool {
        let all = self.formed + self.missing;
        self.missing > MIN_MISSED * all && self.missing > MIN_BRIGHTNESS * brightest
    }
}
