//! The estimators, one file per estimator. Each file fills a [`Record`] of plain data. `settings` and `render` read that record;
//! they never branch on the estimator itself.

#![warn(missing_docs)]

mod bdpt;
mod epc;
mod lcs;
mod lcs_paper;
mod pt;

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::scene::LightKind;

/// Which paths a render forms, and how it chooses connections.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Estimator {
    /// Path tracing with next-event estimation: strategies s <= 1.
    Pt,
    /// Full bidirectional path tracing; paths outside the gate are rejected.
    Bdpt,
    /// Ellipsoidal path connections: bidirectional path tracing that draws the travel time inside the gate.
    Epc,
    /// Light-cone shell queries as in the paper (Secs. 5 and 6); `docs/ARCHITECTURE.md` lists our decisions beyond the paper.
    LcsPaper,
    /// Light-cone shell queries by importance; K candidates per tree are resampled to one shadow ray.
    Lcs,
}

/// Everything about an estimator that the settings, the renderer and the bench need to know.
pub struct Record {
    /// The name on the command line.
    pub name: &'static str,
    /// Whether this estimator is the default under these conditions. Exactly one estimator is, whatever the conditions.
    pub is_default: fn(&Conditions) -> bool,
    /// Upper bound on the default number of light subpaths per iteration. `has_several`: whether there are several responses.
    pub max_default_light_paths: fn(has_several: bool) -> u32,
    /// Default of adaptive sampling: whether the sample allocation follows the error of the pixels.
    pub adaptive: bool,
    /// Whether light subpaths continue beyond the emitter, so that the strategies t = 1 and s >= 2 exist. Without these
    /// strategies an estimator finds no light of beams.
    pub light_subpaths: bool,
    /// Defaults of the tree settings; `None` for an estimator without trees.
    pub trees: Option<TreeDefaults>,
    /// How the light vertices of an iteration are ordered for the query kernel.
    pub pool_order: PoolOrder,
    /// Kernel that chooses light vertices for the shade points: file and entry point.
    pub query_kernel: &'static str,
    /// Override constants of that kernel.
    pub constants: &'static [(&'static str, u32)],
    /// Number of candidate slots per shade point for the vertices that the query kernel chooses. Deterministic vertices have
    /// other slots.
    pub slots: fn(&PoolShape) -> u32,
    /// Number of equal parts into which the support is divided, unless the responses are a single box. The query kernel chooses a vertex
    /// for each part. 1 if it chooses vertices without regard to parts. At most MAX_TIME_GROUPS.
    pub time_groups: u32,
    /// The record that replaces this one if the responses are not a single box and their support is wide: nearly every light vertex
    /// then meets some gate.
    pub for_histograms: Option<&'static Record>,
    /// The record that replaces this one if the gate is thin, because few pairs of vertices then meet the gate. `--ellipsoids on` uses
    /// it in any gate, `--ellipsoids off` in none.
    pub for_thin_gates: Option<&'static Record>,
    /// Number of light vertices that the query kernel draws for each query that `--queries` asks for.
    pub draws_per_query: u32,
    /// Number of samples that a vertex chosen by `queries` queries stands for in the MIS heuristic.
    pub query_sample_count: fn(queries: u32, has_media: bool) -> f32,
    /// Weight of a light-tracing (t = 1) sample in the MIS heuristic, relative to one camera sample.
    pub splat_sample_weight: f32,
    /// Whether an event in a medium is drawn inside the gate for a connection to a deterministic vertex, instead of by free flight.
    /// Then the first event on a beam is also drawn inside the gate, for its connection to the sensor.
    pub draws_in_gate: bool,
    /// How connections that are too short for the gate run over an auxiliary vertex on an ellipsoid.
    pub ellipsoids: Ellipsoids,
    /// Number of samples that an ellipsoidal connection counts for in the MIS heuristic.
    pub ellipsoid_sample_count: f32,
    /// Whether the bench considers this estimator when it looks for the fastest way to render a reference.
    pub renders_references: bool,
    /// Whether the bench compares the errors of the other estimators with the errors of this one.
    pub is_baseline: bool,
    /// Estimator that checks the references rendered by this one: it finds the same paths by another method.
    pub judge: Estimator,
}

/// What most estimators have in common. Each of them has a name, constants and slots of its own.
const PLAIN: Record = Record {
    name: "",
    is_default: |_| false,
    max_default_light_paths: |_| 50_000,
    adaptive: true,
    light_subpaths: true,
    trees: None,
    pool_order: PoolOrder::ByPath,
    query_kernel: COMMON_QUERY_KERNEL,
    constants: &[],
    slots: |_| 0,
    time_groups: 1,
    for_histograms: None,
    for_thin_gates: None,
    draws_per_query: 1,
    query_sample_count: |_, _| 1.0,
    splat_sample_weight: 1.0,
    draws_in_gate: false,
    ellipsoids: Ellipsoids::None,
    ellipsoid_sample_count: 1.0,
    renders_references: false,
    is_baseline: false,
    judge: Estimator::Bdpt,
};

/// How an estimator forms ellipsoidal connections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ellipsoids {
    /// No ellipsoidal connections.
    None,
    /// One connection for each light vertex that is too near for the gate. All triangles that the ellipsoid meets are listed.
    Enumerated,
    /// One connection per shade point, resampled from several candidates whose triangles are drawn by importance.
    Resampled,
}

/// Properties of the scene and the gate that the default estimator depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Conditions {
    /// Width of the gate, or of the gate that decides among several.
    pub gate: GateWidth,
    /// Whether there are several responses.
    pub has_several: bool,
    /// Whether glass, a mirror or sharp gloss focuses light.
    pub focuses_light: bool,
    /// Whether the scene has a collimated beam.
    pub has_beam: bool,
    /// Whether the scene has a sun or a sky.
    pub has_distant: bool,
    /// How much the media of the scene scatter.
    pub fog: Fog,
}

/// How much the media of a scene scatter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fog {
    /// Not at all.
    None,
    /// Less than `Thick`.
    Thin,
    /// Light that crosses the scene scatters several times.
    Thick,
}

/// Width of the gate relative to the size of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GateWidth {
    /// Narrow enough that queries in trees pay off.
    Narrow,
    /// Wider than `Narrow`, but not without limits.
    Wide,
    /// No gate: the steady state.
    Open,
}

/// Defaults of an estimator that keeps its light vertices in trees.
pub struct TreeDefaults {
    /// Queries per shade point and tree: K of the paper, or candidates for one shadow ray.
    pub queries: u32,
    /// Upper bound on the light vertices in a leaf.
    pub leaf_size: u32,
    /// Whether one tree holds all light vertices, instead of the two trees of Sec. 5.4.
    pub single: bool,
    /// Whether queries choose by importance and start from a frontier of subtrees: `--importance` and `--frontier` have an
    /// effect.
    pub by_importance: bool,
}

/// Order of the light vertices in the pool. Deterministic vertices come first in every order, unless queries find them in trees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoolOrder {
    /// The pool holds points on emitters only.
    EmitterPoints,
    /// By light subpath; the pool stores the offset of each path.
    ByPath,
    /// By leaf of the trees.
    Trees,
    /// By travel time; one tree node holds the bounds of all vertices that are not deterministic, and their number.
    ByTime,
}

/// Properties of an iteration's pool and of the settings that determine the number of slots.
#[derive(Debug, Clone, Copy)]
pub struct PoolShape {
    /// Whether vertices on emitters come right after the deterministic vertices.
    pub has_emitter_vertices: bool,
    /// Number of vertices of the longest light subpath; 0 if the pool is not ordered by path.
    pub longest_path: u32,
    /// Number of trees that are not empty. A pool that is ordered by travel time counts as one tree.
    pub trees: u32,
    /// Number of parts of the support; the query kernel may choose a vertex for each part. See [`Record::time_groups`].
    pub time_groups: u32,
    /// Queries per shade point and tree, times [`Record::draws_per_query`].
    pub queries: u32,
}

/// Query kernel that all estimators share; `lcs` uses it only for histograms. Its constant `ESTIMATOR` selects how it chooses light
/// vertices. Its name comes from the light-cone shell queries of `lcs-paper`.
const COMMON_QUERY_KERNEL: &str = "shell_query";

impl Estimator {
    /// All estimators, the simplest first.
    pub const ALL: [Estimator; 5] =
        [Estimator::Pt, Estimator::Bdpt, Estimator::Epc, Estimator::LcsPaper, Estimator::Lcs];

    /// Estimator for renders without a gate, if none was chosen or the render measures travel times. It finds the light of every kind
    /// of emitter.
    pub const UNGATED: Estimator = Estimator::Bdpt;

    /// Whether each connection searches all triangles of the scene.
    #[doc(hidden)]
    pub fn searches_all_triangles(self) -> bool {
        self.record().ellipsoids == Ellipsoids::Enumerated
    }

    /// The record that describes this estimator to the rest of the program.
    #[doc(hidden)]
    pub fn record(self) -> &'static Record {
        match self {
            Estimator::Pt => &pt::RECORD,
            Estimator::Bdpt => &bdpt::RECORD,
            Estimator::Epc => &epc::RECORD,
            Estimator::LcsPaper => &lcs_paper::RECORD,
            Estimator::Lcs => &lcs::RECORD,
        }
    }

    /// The estimator that renders under these conditions unless the user names one.
    #[doc(hidden)]
    pub fn default_for(conditions: &Conditions) -> Estimator {
        let is_default = |estimator: &Estimator| (estimator.record().is_default)(conditions);
        Estimator::ALL.into_iter().find(is_default).expect("one estimator is the default for any conditions")
    }

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        self.record().name
    }

    /// Whether the estimator keeps its light vertices in trees.
    pub fn has_trees(self) -> bool {
        self.record().trees.is_some()
    }

    /// Whether queries choose light vertices by importance.
    pub fn by_importance(self) -> bool {
        self.record().trees.as_ref().is_some_and(|trees| trees.by_importance)
    }

    /// Default number of queries per shade point and tree; 1 without trees.
    pub fn default_queries(self) -> u32 {
        self.record().trees.as_ref().map_or(1, |trees| trees.queries)
    }

    /// Whether the default is one tree over all light vertices.
    pub fn default_single_tree(self) -> bool {
        self.record().trees.as_ref().is_some_and(|trees| trees.single)
    }

    /// Default upper bound on the light vertices in a leaf; 0 without trees.
    pub fn leaf_size(self) -> u32 {
        self.record().trees.as_ref().map_or(0, |trees| trees.leaf_size)
    }

    /// Whether the estimator finds the light of collimated beams.
    fn sees_beams(self) -> bool {
        self.record().light_subpaths
    }

    /// Whether the estimator finds no light of this kind of lamp.
    pub fn misses(self, kind: &LightKind) -> bool {
        kind.needs_light_subpaths() && !self.sees_beams()
    }

    /// Error message for a user who asks this estimator for the light of `beam`, which it cannot find. It names the estimators
    /// that can.
    pub fn beam_refusal(self, beam: &str) -> String {
        let seeing: Vec<&str> = Estimator::ALL.into_iter().filter(|e| e.sees_beams()).map(Estimator::name).collect();
        format!(
            "--estimator {self} cannot see the light of {beam} (no ray hits a collimated beam, no point on it can be connected); \
             use {}",
            any_of(&seeing)
        )
    }
}

/// `a, b or c`
fn any_of(names: &[&str]) -> String {
    match names {
        [all @ .., last] if !all.is_empty() => format!("{} or {last}", all.join(", ")),
        _ => names.concat(),
    }
}

impl fmt::Display for Estimator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Estimator {
    type Err = Error;

    fn from_str(text: &str) -> Result<Estimator> {
        Estimator::ALL.into_iter().find(|e| e.name() == text).ok_or_else(|| {
            let names = Estimator::ALL.map(Estimator::name);
            Error::advice(format!("no estimator is called '{text}': "), format!("choose {}", any_of(&names)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_estimator_is_the_default_for_any_conditions() {
        for gate in [GateWidth::Narrow, GateWidth::Wide, GateWidth::Open] {
            for fog in [Fog::None, Fog::Thin, Fog::Thick] {
                for switches in 0..16 {
                    let [has_several, focuses_light, has_beam, has_distant] =
                        [1, 2, 4, 8].map(|bit| switches & bit != 0);
                    let conditions = Conditions { gate, has_several, focuses_light, has_beam, has_distant, fog };
                    let is_default = |e: &Estimator| (e.record().is_default)(&conditions);
                    let defaults: Vec<Estimator> = Estimator::ALL.into_iter().filter(is_default).collect();
                    assert_eq!(defaults.len(), 1, "{conditions:?}: {defaults:?}");
                    assert!(!has_beam || defaults[0].sees_beams(), "{conditions:?}: {defaults:?}");
                }
            }
        }
    }

    #[test]
    fn names_parse_to_their_estimator() {
        for estimator in Estimator::ALL {
            assert_eq!(estimator.to_string().parse::<Estimator>().unwrap(), estimator);
        }
        let error = "magic".parse::<Estimator>().unwrap_err().to_string();
        assert_eq!(error, "no estimator is called 'magic': choose pt, bdpt, epc, lcs-paper or lcs");
    }

    #[test]
    fn a_judge_finds_the_same_paths_in_another_way() {
        for estimator in Estimator::ALL {
            let judge = estimator.record().judge;
            assert!(judge != estimator && judge.record().light_subpaths, "{estimator}: {judge}");
        }
    }

    #[test]
    fn a_refusal_names_what_does_see_beams() {
        let refusal = Estimator::Pt.beam_refusal("the beam 'laser'");
        assert!(
            refusal.contains("the beam 'laser'") && refusal.ends_with("use bdpt, epc, lcs-paper or lcs"),
            "{refusal}"
        );
    }
}
