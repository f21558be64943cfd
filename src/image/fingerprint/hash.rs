//! The hash function of all fingerprints. The build script includes this file too.

/// FNV-1a with 64 bits. It does not resist inputs that somebody made to collide.
#[derive(Clone, Copy)]
pub struct Hash(u64);

impl Hash {
    #[allow(clippy::new_without_default, reason = "a default hash has no meaning")]
    pub fn new() -> Hash {
        Hash(0xcbf2_9ce4_8422_2325)
    }

    /// The hash with more bytes, and with their number, so that `ab, c` and `a, bc` differ.
    pub fn with(self, bytes: &[u8]) -> Hash {
        let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        Hash(bytes.iter().chain(&(bytes.len() as u64).to_le_bytes()).fold(self.0, step))
    }

    /// The hash as 16 hexadecimal digits.
    pub fn digits(self) -> String {
        format!("{:016x}", self.0)
    }
}
