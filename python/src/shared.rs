//! Parts of the program that the module uses as they are.

#![allow(dead_code)]

#[path = "../../src/app/render/sums.rs"]
pub mod sums;
