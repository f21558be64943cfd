//! Uses the page of `taugate view` as a person does: in a real browser, Debian's `chromium`, which `chromedriver` drives. Where one of
//! them is absent, these tests print that they are skipped. They need a Vulkan device.
//!
//! The program must be built before: target/release/taugate, or the one that TAUGATE_PROGRAM names.
//!
//! Environment: TAUGATE_AXE, the file `axe.min.js` of axe-core, for the check of accessibility.

#![cfg(test)]

mod access;
mod browser;
mod camera;
mod connection;
mod gate;
mod picture;
mod pictures;
mod program;
mod relay;
mod speed;
