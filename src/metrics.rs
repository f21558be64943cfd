//! Error of an image against a reference.
