//! Whole renders, compared with closed forms, with each other and with the oracle; and renders that must agree bit for bit.

mod agreement;
mod aperture;
mod beam_in_fog;
mod camera;
mod caustics;
mod cells;
#[path = "../common/orthographic.rs"]
mod closed_form;
mod continuous_wave;
mod determinism;
#[path = "../common/device.rs"]
mod device;
mod drive;
mod ellipsoids;
mod fog;
mod fog_and_glass;
mod furnace;
mod grid;
mod headlamp;
mod in_flight;
mod inside_glass;
mod interiors;
mod lamps;
mod lens;
mod merging;
mod moving_lidar;
mod null_boundaries;
mod orthographic;
mod regressions;
mod responses;
mod retroreflector;
mod rough_glass;
mod sampling;
mod scan;
mod shared_scenes;
mod sky;
mod sphere;
mod strategies;
mod sun;
mod surface;
mod thin_glass;
mod trees;
mod turned_glass;
mod water;
mod waveforms;
mod z_map;
