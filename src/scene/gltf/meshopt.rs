//! Decodes the streams of EXT_meshopt_compression and KHR_meshopt_compression.
//!
//! The names and steps are those of appendices A (bitstream) and B (filters) of KHR_meshopt_compression, which also cover the
//! older extension. A stream comes from a file, so every read is checked. Before memory is allocated, the stream must be long
//! enough for its number of elements.

mod filter;
mod triangles;

use serde::Deserialize;

/// The bitstream of a compressed buffer view.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum Mode {
    Attributes,
    Triangles,
    Indices,
}

/// What happens to each element after decompression.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum Filter {
    #[default]
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

/// Whether a stream of this mode and filter may have elements of `stride` bytes, and whether this mode allows `count` elements.
pub fn is_valid(mode: Mode, filter: Filter, count: usize, stride: usize) -> bool {
    let fits_mode = match mode {
        Mode::Attributes => stride.is_multiple_of(4) && (4..=256).contains(&stride),
        Mode::Triangles => matches!(stride, 2 | 4) && count.is_multiple_of(3),
        Mode::Indices => matches!(stride, 2 | 4),
    };
    let fits_filter = match filter {
        Filter::None => true,
        Filter::Octahedral | Filter::Color => matches!(stride, 4 | 8),
        Filter::Quaternion => stride == 8,
        Filter::Exponential => stride.is_multiple_of(4),
    };
    fits_mode && fits_filter && (mode == Mode::Attributes || filter == Filter::None)
}

/// The `count` elements of `stride` bytes in the stream `data`; `None` if the stream is damaged. The arguments must be valid,
/// see [`is_valid`].
pub fn decode(mode: Mode, filter: Filter, count: usize, stride: usize, data: &[u8]) -> Option<Vec<u8>> {
    let words = match mode {
        Mode::Attributes => {
            let mut bytes = attributes(data, count, stride)?;
            filter::apply(filter, stride, &mut bytes);
            return Some(bytes);
        }
        Mode::Triangles => triangles::decode(data, count)?,
        Mode::Indices => indices(data, count)?,
    };
    Some(words.into_iter().flat_map(|word| word.to_le_bytes().into_iter().take(stride)).collect())
}

/// Removes the first `count` bytes of `data` and returns them.
fn take<'a>(data: &mut &'a [u8], count: usize) -> Option<&'a [u8]> {
    let (head, rest) = data.split_at_checked(count)?;
    *data = rest;
    Some(head)
}

/// Elements per group: the deltas of a group have the same number of bits.
const GROUP: usize = 16;
/// Maximum number of elements per block.
const MAX_BLOCK: usize = 256;

/// Decodes a stream of [`Mode::Attributes`]: `count` elements of `stride` bytes. `None` if the stream is damaged.
fn attributes(data: &[u8], count: usize, stride: usize) -> Option<Vec<u8>> {
    let (header, body) = data.split_first()?;
    let is_v1 = match header {
        0xa0 => false,
        0xa1 => true,
        _ => return None,
    };
    let channels = stride / 4;
    // The tail is at the end of the stream, behind its padding. It is the baseline, to which the first deltas are added, and in version 1
    // also one mode per channel.
    let tail = stride + if is_v1 { channels } else { 0 };
    let padded = tail.max(if is_v1 { 24 } else { 32 });
    let (mut data, end) = body.split_at_checked(body.len().checked_sub(padded)?)?;
    let (baseline, modes) = end[padded - tail..].split_at(stride);

    let block_elements = ((8192 / stride) & !(GROUP - 1)).min(MAX_BLOCK);
    let shortest_block = if is_v1 { channels } else { stride };
    if count.div_ceil(block_elements).checked_mul(shortest_block)? > data.len() {
        return None;
    }
    let mut out = vec![0; count * stride];
    let mut last = baseline.to_vec();
    let mut deltas = [[0; MAX_BLOCK]; 4];
    for block in out.chunks_mut(block_elements * stride) {
        let elements = block.len() / stride;
        let controls = if is_v1 { take(&mut data, channels)? } else { &[] };
        for channel in 0..channels {
            for (byte, deltas) in deltas.iter_mut().enumerate() {
                let bits: [u32; 4] = match controls.get(channel).map(|control| control >> (2 * byte) & 3) {
                    None => [0, 2, 4, 8],
                    Some(0) => [0, 1, 2, 4],
                    Some(1) => [1, 2, 4, 8],
                    Some(2) => {
                        deltas.fill(0);
                        continue;
                    }
                    Some(_) => {
                        deltas[..elements].copy_from_slice(take(&mut data, elements)?);
                        continue;
                    }
                };
                read_groups(&mut data, &mut deltas[..elements.next_multiple_of(GROUP)], bits)?;
            }
            let mode = modes.get(channel).copied().unwrap_or(0);
            let last = last[4 * channel..].first_chunk_mut::<4>()?;
            for (i, element) in block.chunks_exact_mut(stride).enumerate() {
                *last = undo_delta(mode, *last, std::array::from_fn(|byte| deltas[byte][i]))?;
                element[4 * channel..][..4].copy_from_slice(last);
            }
        }
    }
    data.is_empty().then_some(out)
}

/// Reads the deltas of one byte of the elements. First come 2 bits per group, which choose the width of its deltas among `bits`.
/// The groups follow.
fn read_groups(data: &mut &[u8], deltas: &mut [u8], bits: [u32; 4]) -> Option<()> {
    let widths = take(data, (deltas.len() / GROUP).div_ceil(4))?;
    for (number, group) in deltas.chunks_exact_mut(GROUP).enumerate() {
        match bits[usize::from(widths[number / 4] >> (number % 4 * 2) & 3)] {
            0 => group.fill(0),
            8 => group.copy_from_slice(take(data, GROUP)?),
            width => {
                let packed = take(data, GROUP * width as usize / 8)?;
                let sentinel = (1u8 << width) - 1;
                for (i, delta) in group.iter_mut().enumerate() {
                    let bit = i as u32 * width;
                    // Deltas of one bit begin at the lowest bit of a byte, wider deltas at the highest.
                    let shift = if width == 1 { bit % 8 } else { 8 - width - bit % 8 };
                    *delta = packed[bit as usize / 8] >> shift & sentinel;
                    if *delta == sentinel {
                        *delta = take(data, 1)?[0];
                    }
                }
            }
        }
    }
    Some(())
}

/// The four bytes of a channel: the bytes `last` of the previous element, changed by `delta`. `None` if the channel mode is
/// unknown.
fn undo_delta(mode: u8, last: [u8; 4], delta: [u8; 4]) -> Option<[u8; 4]> {
    match (mode & 15, mode >> 4) {
        (0, 0) => Some(std::array::from_fn(|byte| {
            let code = delta[byte];
            last[byte].wrapping_add(code >> 1 ^ (code & 1).wrapping_neg())
        })),
        (1, 0) => {
            let half = |at: usize| {
                let code = u16::from_le_bytes([delta[at], delta[at + 1]]);
                let last = u16::from_le_bytes([last[at], last[at + 1]]);
                last.wrapping_add(code >> 1 ^ (code & 1).wrapping_neg()).to_le_bytes()
            };
            let ([a, b], [c, d]) = (half(0), half(2));
            Some([a, b, c, d])
        }
        (2, rotation) => {
            let code = u32::from_le_bytes(delta).rotate_right(rotation.into());
            Some((u32::from_le_bytes(last) ^ code).to_le_bytes())
        }
        _ => None,
    }
}

/// Decodes a stream of [`Mode::Indices`]: `count` indices. Each is stored as the difference from one of two earlier indices; the
/// lowest bit of its code chooses which. `None` if the stream is damaged.
fn indices(data: &[u8], count: usize) -> Option<Vec<u32>> {
    let (0xd1, body) = data.split_first()? else { return None };
    let mut data = body.get(..body.len().checked_sub(4)?)?;
    // Every index takes at least one byte.
    if count > data.len() {
        return None;
    }
    let mut last = [0u32; 2];
    let mut out = Vec::with_capacity(count);
    for _ in 0..count {
        let code = varint(&mut data)?;
        let last = &mut last[code as usize & 1];
        *last = last.wrapping_add(code >> 2 ^ (code >> 1 & 1).wrapping_neg());
        out.push(*last);
    }
    data.is_empty().then_some(out)
}

/// An unsigned LEB128 number of 1 to 5 bytes; bits above 32 are ignored.
fn varint(data: &mut &[u8]) -> Option<u32> {
    let mut value = 0;
    for shift in (0..35).step_by(7) {
        let byte = take(data, 1)?[0];
        value |= u32::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use base64::Engine;
    use base64::prelude::BASE64_STANDARD;

    use super::*;

    #[test]
    fn deltas_of_the_specification_are_read() {
        let mut data: &[u8] = &[0x00, 0x17, 0x5f, 0xf0, 0xbc, 0x77, 0xa9, 0x21, 0x00, 0x34, 0xb5];
        let mut deltas = [0; 16];
        read_groups(&mut data, &mut deltas, [4; 4]).unwrap();
        let mut last = [0; 4];
        let want = [-1, -4, -3, 26, -91, 0, -6, 6, -4, -4, 5, -5, 1, -1, 0, 0i8];
        for (delta, want) in deltas.into_iter().zip(want) {
            let next = undo_delta(0, last, [delta, 0, 0, 0]).unwrap();
            assert_eq!(next[0].wrapping_sub(last[0]) as i8, want);
            last = next;
        }
        assert!(data.is_empty());
    }

    #[test]
    fn numbers_of_variable_length_are_read() {
        for (mut bytes, want) in
            [(&[0x7f][..], Some(0x7f)), (&[0x81, 0x04], Some(0x201)), (&[0xff, 0xa0, 0x05], Some(0x1507f))]
        {
            assert_eq!(varint(&mut bytes), want);
        }
        assert_eq!(varint(&mut &[0x80; 6][..]), None);
        assert_eq!(varint(&mut &[0x80][..]), None);
    }

    /// One stream of `streams.txt`, which meshoptimizer's own encoder and decoder wrote.
    struct Known {
        mode: Mode,
        filter: Filter,
        count: usize,
        stride: usize,
        stream: Vec<u8>,
        elements: Vec<u8>,
    }

    fn known() -> Vec<Known> {
        let parse = |line: &str| {
            let [mode, filter, count, stride, stream, elements] = line.split(' ').collect::<Vec<_>>()[..] else {
                panic!("{line}")
            };
            let bytes = |text: &str| BASE64_STANDARD.decode(text).unwrap();
            let (mode, filter) = (serde_json::from_value(mode.into()), serde_json::from_value(filter.into()));
            Known {
                mode: mode.unwrap(),
                filter: filter.unwrap(),
                count: count.parse().unwrap(),
                stride: stride.parse().unwrap(),
                stream: bytes(stream),
                elements: bytes(elements),
            }
        };
        include_str!("../../../tests/data/compressed/streams.txt").lines().map(parse).collect()
    }

    #[test]
    fn streams_of_meshoptimizer_are_decoded() {
        for Known { mode, filter, count, stride, stream, elements } in known() {
            assert!(is_valid(mode, filter, count, stride));
            let decoded = decode(mode, filter, count, stride, &stream).unwrap();
            // Filters are specified up to one unit of the result, except for floats.
            let is_near = match (filter, stride) {
                (Filter::None | Filter::Exponential, _) => decoded == elements,
                (_, 4) => decoded.iter().zip(&elements).all(|(a, b)| matches!(a.wrapping_sub(*b), 0 | 1 | 255)),
                _ => {
                    let word = |bytes: &[u8], at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
                    let near = |at| matches!(word(&decoded, at).wrapping_sub(word(&elements, at)), 0 | 1 | 0xffff);
                    (0..elements.len()).step_by(2).all(near)
                }
            };
            assert!(is_near, "{mode:?} {filter:?} {count} {stride}: {decoded:?} is not {elements:?}");
        }
    }

    #[test]
    fn damaged_streams_are_refused_or_give_other_elements() {
        for Known { mode, filter, count, stride, stream, .. } in known() {
            for length in 0..stream.len() {
                assert!(decode(mode, filter, count, stride, &stream[..length]).is_none(), "{mode:?} cut at {length}");
            }
            for at in (0..stream.len()).step_by(1 + stream.len() / 64) {
                for bit in 0..8 {
                    let mut damaged = stream.clone();
                    damaged[at] ^= 1 << bit;
                    let decoded = decode(mode, filter, count, stride, &damaged);
                    assert!(decoded.is_none_or(|elements| elements.len() == count * stride));
                }
            }
        }
    }

    #[test]
    fn memory_is_allocated_only_for_streams_that_are_long_enough() {
        let huge = 3 << 40;
        for (mode, header) in
            [(Mode::Attributes, 0xa0), (Mode::Attributes, 0xa1), (Mode::Triangles, 0xe1), (Mode::Indices, 0xd1)]
        {
            let stream = [&[header][..], &[0; 1000]].concat();
            assert!(decode(mode, Filter::None, huge, 4, &stream).is_none());
        }
    }
}
