//! Levels 4 and 5 of the ladder: whole renders against closed forms, against each other, against the oracle, bit for bit.

mod agreement;
mod camera;
mod caustics;
mod cells;
mod determinism;
mod drive;
mod furnace;
mod lamps;
mod regressions;
mod rough_glass;
mod sampling;
mod shared_scenes;
mod sphere;
mod strategies;
mod trees;
mod z_map;
