//! Finds JPEG images with which the decoder `zune-jpeg` 0.5 panics.

/// True if a colour channel of this JPEG image has more samples than the first channel, in a row or in a column. `zune-jpeg` computes
/// the size of a channel's rows from the maximum sampling factors of this channel and the channels before it. It ignores later channels.
/// For such images its buffers have wrong sizes, and a write beyond their end panics. No program saves such images.
///
/// The decoder skips bytes between markers. So this function looks for a frame header everywhere, not only where one should be.
pub fn samples_colour_finer(bytes: &[u8]) -> bool {
    bytes.windows(10).enumerate().any(|(at, header)| {
        // The decoder accepts zeros between the two bytes of a marker.
        let &[0 | 0xff, 0xc0..=0xc2, 0, length, 8, .., channels] = header else { return false };
        let channels = usize::from(channels);
        let Some(rest) = bytes.get(at + 10..at + 10 + 3 * channels) else { return false };
        let mut samples = rest.chunks_exact(3).map(|channel| [channel[1] >> 4, channel[1] & 15]);
        let Some(first) = samples.next() else { return false };
        usize::from(length) == 8 + 3 * channels && samples.any(|more| more[0] > first[0] || more[1] > first[1])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The beginning of a JPEG image whose three channels have these sampling factors (hexadecimal digits: horizontal, vertical).
    fn header(samples: [u8; 3]) -> Vec<u8> {
        let mut bytes = b"\xff\xd8\xff\xc0\0\x11\x08\0\x07\0\x09\x03".to_vec();
        bytes.extend(samples.iter().zip(1..).flat_map(|(samples, id)| [id, *samples, 0]));
        bytes
    }

    #[test]
    fn only_fine_colours_are_found() {
        for usual in [[0x11, 0x11, 0x11], [0x21, 0x11, 0x11], [0x22, 0x12, 0x21], [0x41, 0x11, 0x11]] {
            assert!(!samples_colour_finer(&header(usual)), "{usual:x?}");
        }
        for odd in [[0x11, 0x21, 0x11], [0x21, 0x22, 0x11], [0x11, 0x11, 0x14]] {
            let bytes = header(odd);
            assert!(samples_colour_finer(&bytes), "{odd:x?}");
            assert!(!samples_colour_finer(&bytes[..bytes.len() - 1]));
            assert!(samples_colour_finer(&[&bytes[..2], b"\xff\0", &bytes[3..]].concat()), "zeros in the marker");
        }
        assert!(!samples_colour_finer(b""));
    }
}
