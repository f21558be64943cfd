//! The estimators: how each one finds paths, one file per estimator. This is plain data below `settings` and `render`; both ask
//! the [`Record`] of an estimator and never which estimator it is.

#![warn(missing_docs)]

mod bdpt;
mod lcs;
mod lcs_paper;
mod pt;

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};

/// Which paths are formed and how connections are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Estimator {
    /// Path tracing with next-event estimation: strategies s <= 1.
    Pt,
    /// Full bidirectional path tracing; paths outside the gate are rejected.
    Bdpt,
    /// Light-cone shell queries as the paper has them (Secs. 5 and 6); `docs/ARCHITECTURE.md` lists what is decided beyond it.
    LcsPaper,
    /// Light-cone shell queries by importance, K candidates resampled to one shadow ray per tree.
    Lcs,
}

/// Everything about an estimator that the settings, the renderer and the bench need to know.
pub struct Record {
    /// The name on the command line.
    pub name: &'static str,
    /// Whether this estimator renders when nothing names one. Exactly one estimator says yes to any conditions.
    pub is_default: fn(&Conditions) -> bool,
    /// Upper bound on the default number of light subpaths per iteration.
    pub max_default_light_paths: u32,
    /// Whether samples follow the error of the pixels when nothing says how to spread them.
    pub adaptive: bool,
    /// Whether light subpaths are continued beyond the emitter: the strategies t = 1 and s >= 2 exist. Without them no path from a
    /// beam is found.
    pub light_subpaths: bool,
    /// Defaults of the tree settings; none for an estimator without trees.
    pub trees: Option<TreeDefaults>,
    /// How the light vertices of an iteration are ordered for the query kernel.
    pub pool_order: PoolOrder,
    /// Kernel that chooses light vertices for the shade points: file and entry point.
    pub query_kernel: &'static str,
    /// Override constants of that kernel.
    pub constants: &'static [(&'static str, u32)],
    /// Candidate slots per shade point for the vertices that the query kernel chooses; deterministic vertices have slots of their
    /// own.
    pub slots: fn(&PoolShape) -> u32,
    /// Number of samples that a vertex chosen by `queries` queries stands for in the MIS heuristic.
    pub query_sample_count: fn(queries: u32) -> f32,
    /// Weight of a light-tracing (t = 1) sample in the MIS heuristic, relative to one camera sample.
    pub splat_sample_weight: f32,
    /// Whether the bench tries this estimator when it looks for the fastest way to render a reference.
    pub renders_references: bool,
    /// Estimator that checks the references which this one rendered: it finds the same paths in another way.
    pub judge: Estimator,
}

/// What the default estimator depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Conditions {
    /// How wide the gate is.
    pub gate: GateWidth,
    /// Glass, a mirror or sharp gloss gathers light.
    pub focuses_light: bool,
    /// A collimated beam shines.
    pub has_beam: bool,
}

/// Width of the gate, compared with the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GateWidth {
    /// At most the width up to which queries in trees pay.
    Narrow,
    /// Wider than that, with an end.
    Wide,
    /// The steady state.
    Open,
}

/// Defaults of an estimator that keeps its light vertices in trees.
pub struct TreeDefaults {
    /// Queries per shade point and tree: K of the paper, or candidates for one shadow ray.
    pub queries: u32,
    /// Upper bound on the light vertices in a leaf.
    pub leaf_size: u32,
    /// One tree over all light vertices instead of the two of Sec. 5.4.
    pub single: bool,
    /// Queries choose by importance, starting among a frontier of subtrees: `--importance` and `--frontier` count.
    pub by_importance: bool,
}

/// Order of the light vertices in the pool. Deterministic vertices come first in all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoolOrder {
    /// Points on emitters alone.
    EmitterPoints,
    /// By light subpath, with an offset per path.
    ByPath,
    /// By the leaves of the trees.
    Trees,
}

/// The pool of an iteration and the settings, as far as the number of slots depends on them.
#[derive(Debug, Clone, Copy)]
pub struct PoolShape {
    /// Whether the pool holds points on emitters.
    pub has_emitter_points: bool,
    /// Vertices of the longest light subpath; 0 where the pool is not ordered by path.
    pub longest_path: u32,
    /// Trees that are not empty.
    pub trees: u32,
    /// Queries per shade point and tree.
    pub queries: u32,
}

/// The kernel of three estimators, which differ in how they choose from the pool: constant `ESTIMATOR`.
const SHELL_QUERY: &str = "shell_query";

impl Estimator {
    /// All of them, the simplest first.
    pub const ALL: [Estimator; 4] = [Estimator::Pt, Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs];

    /// Finds every path, whatever its travel time: it measures what there is to gate.
    pub const UNGATED: Estimator = Estimator::Bdpt;

    /// What all others read of it.
    pub fn record(self) -> &'static Record {
        match self {
            Estimator::Pt => &pt::RECORD,
            Estimator::Bdpt => &bdpt::RECORD,
            Estimator::LcsPaper => &lcs_paper::RECORD,
            Estimator::Lcs => &lcs::RECORD,
        }
    }

    /// The estimator that renders when nothing names one.
    pub fn default_for(conditions: &Conditions) -> Estimator {
        let is_default = |estimator: &Estimator| (estimator.record().is_default)(conditions);
        Estimator::ALL.into_iter().find(is_default).expect("one estimator is the default for any conditions")
    }

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        self.record().name
    }

    /// Whether its light vertices stand in trees.
    pub fn has_trees(self) -> bool {
        self.record().trees.is_some()
    }

    /// Whether queries choose light vertices by importance.
    pub fn by_importance(self) -> bool {
        self.record().trees.as_ref().is_some_and(|trees| trees.by_importance)
    }

    /// Queries per shade point and tree when nothing says how many.
    pub fn default_queries(self) -> u32 {
        self.record().trees.as_ref().map_or(1, |trees| trees.queries)
    }

    /// Whether there is one tree over all light vertices when nothing says it.
    pub fn default_single_tree(self) -> bool {
        self.record().trees.as_ref().is_some_and(|trees| trees.single)
    }

    /// Upper bound on the light vertices in a leaf when nothing says how many; 0 without trees.
    pub fn leaf_size(self) -> u32 {
        self.record().trees.as_ref().map_or(0, |trees| trees.leaf_size)
    }

    /// Whether light of a collimated beam is found.
    pub fn sees_beams(self) -> bool {
        self.record().light_subpaths
    }

    /// A sentence for whoever asks this estimator for the light of a beam that it cannot see.
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
            Error::Settings(format!("no estimator is called '{text}': choose {}", any_of(&names)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_estimator_is_the_default_for_any_conditions() {
        for gate in [GateWidth::Narrow, GateWidth::Wide, GateWidth::Open] {
            for [focuses_light, has_beam] in [[false, false], [false, true], [true, false], [true, true]] {
                let conditions = Conditions { gate, focuses_light, has_beam };
                let is_default = |e: &Estimator| (e.record().is_default)(&conditions);
                let defaults: Vec<Estimator> = Estimator::ALL.into_iter().filter(is_default).collect();
                assert_eq!(defaults.len(), 1, "{conditions:?}: {defaults:?}");
                assert!(!has_beam || defaults[0].sees_beams(), "{conditions:?}: {defaults:?}");
            }
        }
    }

    #[test]
    fn names_parse_to_their_estimator() {
        for estimator in Estimator::ALL {
            assert_eq!(estimator.to_string().parse::<Estimator>().unwrap(), estimator);
        }
        let error = "magic".parse::<Estimator>().unwrap_err().to_string();
        assert_eq!(error, "no estimator is called 'magic': choose pt, bdpt, lcs-paper or lcs");
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
        assert!(refusal.contains("the beam 'laser'") && refusal.ends_with("use bdpt, lcs-paper or lcs"), "{refusal}");
    }
}
