//! The kinds of emitters on the device. Questions about a kind are matches that list all of them, so a new kind does not compile
//! until each has an answer.

use crate::wgsl::layout::Emitter;
use crate::wgsl::layout::constants::*;

/// The kind of an [`Emitter`], with the number that kernels know it by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum EmitterKind {
    /// A triangle of a surface that emits.
    Triangle = EMITTER_TRIANGLE,
    Point = EMITTER_POINT,
    Spot = EMITTER_SPOT,
    Beam = EMITTER_BEAM,
    Sun = EMITTER_SUN,
    Sky = EMITTER_SKY,
}

impl EmitterKind {
    /// The kind of an entry of the emitter table.
    pub fn of(entry: &Emitter) -> EmitterKind {
        match entry.kind {
            EMITTER_TRIANGLE => EmitterKind::Triangle,
            EMITTER_POINT => EmitterKind::Point,
            EMITTER_SPOT => EmitterKind::Spot,
            EMITTER_BEAM => EmitterKind::Beam,
            EMITTER_SUN => EmitterKind::Sun,
            EMITTER_SKY => EmitterKind::Sky,
            other => unreachable!("emitters have no kind {other}"),
        }
    }

    /// Whether a ray can hit the emitter.
    pub fn can_be_hit(self) -> bool {
        match self {
            EmitterKind::Triangle | EmitterKind::Sky => true,
            EmitterKind::Point | EmitterKind::Spot | EmitterKind::Beam | EmitterKind::Sun => false,
        }
    }

    /// Whether shade points can be connected to points on the emitter. Not to a beam: all its photons travel in one direction, and
    /// only light subpaths find its light.
    pub fn is_connectable(self) -> bool {
        match self {
            EmitterKind::Beam => false,
            EmitterKind::Triangle | EmitterKind::Point | EmitterKind::Spot | EmitterKind::Sun | EmitterKind::Sky => {
                true
            }
        }
    }

    /// Whether the emitter is infinitely far away, outside of all solids.
    pub fn is_distant(self) -> bool {
        match self {
            EmitterKind::Sun | EmitterKind::Sky => true,
            EmitterKind::Triangle | EmitterKind::Point | EmitterKind::Spot | EmitterKind::Beam => false,
        }
    }

    /// Whether all light of the emitter has one direction.
    pub fn is_parallel(self) -> bool {
        match self {
            EmitterKind::Beam | EmitterKind::Sun => true,
            EmitterKind::Triangle | EmitterKind::Point | EmitterKind::Spot | EmitterKind::Sky => false,
        }
    }
}
