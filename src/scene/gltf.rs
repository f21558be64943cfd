//! glTF 2.0 to [`Scene`](super::Scene).
