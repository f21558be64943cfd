//! The same mathematics again: slow, f64, obviously right. For tests only.
