//! Measures when light arrives and which surfaces the pixels show. The image depends on neither. So if a measurement fails, the
//! render goes on, and the page has no histogram or no depths.

use taugate::Result;
use taugate::internals::input::responses::chosen;
use taugate::internals::job::feasible;
use taugate::internals::render::{PreparedScene, TravelTimes, first_surfaces, probe};
use taugate::internals::settings::units::Gate;

use super::board::{Surfaces, Topic};
use super::engine::Engine;
use super::message::{Arrivals, Report, Response};

/// Number of bins of the histogram. It ends when [`ARRIVAL_PERCENT`] of the light has arrived.
const ARRIVAL_BINS: usize = 256;
const ARRIVAL_PERCENT: f64 = 99.5;
/// Name of the gate that the user gave on the command line.
const AT_START: &str = "As at the start";
/// Gates that a page offers: name, and percentage of the light that arrives before the middle of the gate.
const PRESETS: [(&str, f64); 3] = [("First light", 5.0), ("Median", feasible::MEDIAN), ("Late light", 95.0)];

impl Engine {
    /// Measures when light arrives, without a gate.
    pub(super) fn measure_arrivals(&mut self) {
        self.work.has_arrivals = true;
        let times = self.arrivals().ok().flatten();
        let end = times.as_ref().and_then(|times| times.percentile(ARRIVAL_PERCENT));
        let bins = times.as_ref().zip(end).map(|(times, end)| times.histogram(end, ARRIVAL_BINS)).unwrap_or_default();
        let begin = bins.first().map_or(0.0, |([begin, _], _)| *begin);
        let preset = |name: &str, gate: Gate| Response { name: name.into(), lo: gate.lo, hi: Some(gate.hi) };
        let (scene, settings) = (self.viewed.scene(), &self.viewed.view().settings);
        let measured = PRESETS.into_iter().filter_map(|(name, percent)| {
            Some(preset(name, feasible::suggestion(times.as_ref()?, scene, settings, percent)?))
        });
        let at_start = chosen(&self.viewed.start().gate).ok().filter(|responses| responses.len() == 1);
        let at_start = at_start.and_then(|responses| responses.iter().next().map(|response| response.gate()));
        let at_start = at_start.filter(|gate| gate.hi.is_finite());
        let arrivals = Arrivals {
            revision: self.work.revision,
            begin,
            end: end.unwrap_or(begin).max(begin),
            light: bins.into_iter().map(|(_, light)| light).collect(),
            presets: measured.chain(at_start.map(|gate| preset(AT_START, gate))).collect(),
        };
        self.board.report(Topic::Arrivals, &Report::Arrivals(arrivals));
    }

    /// The travel times of all light that has one; `None` if all light comes from infinitely far away.
    fn arrivals(&self) -> Result<Option<TravelTimes>> {
        let (scene, settings) = (self.viewed.scene(), &self.viewed.view().settings);
        let prepared = &self.work.renderers.as_ref().expect("the scene is prepared").prepared;
        if !prepared.has_distant() {
            return probe(&self.device, scene, settings, prepared).map(Some);
        }
        match PreparedScene::without_distant(scene, settings) {
            Some((settings, prepared)) => probe(&self.device, scene, &settings, &prepared).map(Some),
            None => Ok(None),
        }
    }

    /// Finds depth, normal and object of every pixel.
    pub(super) fn find_surfaces(&mut self) {
        self.work.has_surfaces = true;
        let (scene, settings) = (self.viewed.scene(), &self.viewed.view().settings);
        let [width, height] = settings.resolution();
        let pixels = width as usize * height as usize;
        let (mut depth, mut normal) = (vec![0.0; pixels], vec![[0.0; 3]; pixels]);
        let mut object = vec![Surfaces::NOTHING; pixels];
        let prepared = &self.work.renderers.as_ref().expect("the scene is prepared").prepared;
        let found = first_surfaces(&self.device, scene, settings, prepared, &mut |pixel, surface| {
            (depth[pixel], normal[pixel], object[pixel]) = (surface.distance, surface.normal, surface.instance);
        });
        if found.is_ok() {
            let names = scene.instances.iter().map(|instance| instance.node.clone()).collect();
            self.board.surfaces(Surfaces { depth, normal, object, names });
        }
    }
}
