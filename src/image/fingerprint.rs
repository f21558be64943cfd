//! Fingerprints of what a result depends on.

use crate::wgsl::SOURCES;

/// To be raised when the host changes what an image is: emission, gates, materials, the weights' frame.
const REVISION: u32 = 2;

/// FNV-1a of 64 bits: enough to tell settings apart that nobody chose to collide.
#[derive(Clone, Copy)]
pub struct Hash(u64);

impl Hash {
    #[allow(clippy::new_without_default, reason = "there is one beginning")]
    pub fn new() -> Hash {
        Hash(0xcbf2_9ce4_8422_2325)
    }

    /// With more bytes, and where they end.
    pub fn with(self, bytes: &[u8]) -> Hash {
        let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        Hash(bytes.iter().chain(&(bytes.len() as u64).to_le_bytes()).fold(self.0, step))
    }

    /// Sixteen hexadecimal digits.
    pub fn digits(self) -> String {
        format!("{:016x}", self.0)
    }
}

/// Sixteen digits for this renderer: its version, [`REVISION`], and all shaders without their comments. Images of renderers that
/// differ in it may differ by more than noise; images of equal ones do not.
pub fn renderer() -> String {
    of(SOURCES)
}

fn of(sources: &[(&str, &str)]) -> String {
    let begin = Hash::new().with(env!("CARGO_PKG_VERSION").as_bytes()).with(&REVISION.to_le_bytes());
    sources.iter().fold(begin, |hash, (name, text)| hash.with(name.as_bytes()).with(code(text).as_bytes())).digits()
}

/// The text without comments, indentation and empty lines: WGSL has no strings.
fn code(text: &str) -> String {
    let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default().trim());
    lines.filter(|line| !line.is_empty()).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_are_no_part_of_a_renderer() {
        let one = of(&[("a", "// What it is.\nfn f() -> f32 {\n    return 1.0;\n}\n")]);
        assert_eq!(of(&[("a", "fn f() -> f32 {\n\n  return 1.0; // Here.\n}\n")]), one);
        for other in [("a", "fn f() -> f32 {\n    return 1.1;\n}\n"), ("b", "fn f() -> f32 {\n    return 1.0;\n}\n")] {
            assert_ne!(of(&[other]), one);
        }
        assert_eq!((renderer().len(), renderer()), (16, renderer()));
    }
}
