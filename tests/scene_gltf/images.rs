//! The formats of images: files that are built here byte by byte, and the texels that their formats prescribe.

use super::*;

type Texel = [u8; 4];

/// The width and the texels of an image.
fn decoded(file: &[u8]) -> Result<(u32, Vec<Texel>), String> {
    let mut glb = complete();
    let view = glb.view(file);
    glb.json["images"][0] = json!({ "bufferView": view });
    let scene = load_slice(&glb.build(), Path::new("test.glb")).map_err(|e| e.to_string())?;
    Ok((scene.images[0].width, scene.images[0].rgba.clone()))
}

/// A chunk of a PNG file.
fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let body = [&kind[..], data].concat();
    [&(data.len() as u32).to_be_bytes()[..], &body, &crc32fast::hash(&body).to_be_bytes()].concat()
}

/// A PNG file with chunks before its pixels. The colour type is 0 for grey, 2 for RGB, 3 for a palette, 4 for grey and alpha, and 6 for
/// RGBA. Each row begins with 0.
pub fn png([width, height, depth, color, is_interlaced]: [u8; 5], chunks: &[Vec<u8>], rows: &[u8]) -> Vec<u8> {
    let header = [0, 0, 0, width, 0, 0, 0, height, depth, color, 0, 0, is_interlaced];
    let [low, high] = (rows.len() as u16).to_le_bytes();
    let (a, b) =
        rows.iter().fold((1, 0), |(a, b), &byte| ((a + u32::from(byte)) % 65521, (b + a + u32::from(byte)) % 65521));
    let stored = [&[0x78, 1, 1, low, high, !low, !high][..], rows, &(b << 16 | a).to_be_bytes()].concat();
    let ends = [chunk(b"IHDR", &header), chunk(b"IDAT", &stored), chunk(b"IEND", &[])];
    [&b"\x89PNG\r\n\x1a\n"[..], &ends[0], &chunks.concat(), &ends[1], &ends[2]].concat()
}

/// How a JPEG file stores its pixels.
#[derive(Debug, Clone, Copy)]
pub struct Jpeg {
    /// The ids of its channels: 1, 2 and so on, but `R`, `G`, `B` if the channels are RGB.
    ids: [u8; 4],
    /// The transform of its `Adobe` segment: 0 for CMYK, 2 for YCCK.
    adobe: Option<u8>,
    is_progressive: bool,
}

pub const YCBCR: Jpeg = Jpeg { ids: [1, 2, 3, 4], adobe: None, is_progressive: false };

/// A JPEG file of 8 x 8 blocks in a row. Each block has one colour: the values of its channels.
pub fn jpeg<const N: usize>(kind: Jpeg, blocks: &[[u8; N]]) -> Vec<u8> {
    let segment = |marker: u8, data: &[u8]| {
        let [high, low] = (data.len() as u16 + 2).to_be_bytes();
        [&[0xff, marker, high, low][..], data].concat()
    };
    let channels = |each: fn(u8) -> Vec<u8>| kind.ids[..N].iter().flat_map(|&id| each(id)).collect::<Vec<u8>>();
    let adobe = kind.adobe.map(|transform| segment(0xee, &[b"Adobe\0\x64\0\0\0\0", &[transform][..]].concat()));
    // All factors are 8, so that the mean of a block minus 128 is its first coefficient.
    let factors = [&[0][..], &[8; 64]].concat();
    let size = [&[8, 0, 8, 0, 8 * blocks.len() as u8, N as u8][..], &channels(|id| vec![id, 0x11, 0])].concat();
    // The code of a first coefficient's number of bits, 0 to 8, is this number in 4 bits. The code of the end of a block is 0 in 1 bit.
    let first = [&[0, 0, 0, 0, 9][..], &[0; 12], &[0, 1, 2, 3, 4, 5, 6, 7, 8]].concat();
    let others = [&[0x10, 1][..], &[0; 15], &[0]].concat();
    let last = if kind.is_progressive { 0 } else { 63 };
    let scan = [&[N as u8][..], &channels(|id| vec![id, 0]), &[0, last, 0]].concat();

    let (mut bits, mut previous) = (String::new(), [128; N]);
    for block in blocks {
        for (previous, &value) in previous.iter_mut().zip(block) {
            let step = i32::from(value) - i32::from(std::mem::replace(previous, value));
            let count = 32 - step.unsigned_abs().leading_zeros();
            bits += &format!("{count:04b}");
            for bit in (0..count).rev() {
                bits.push(if (step.abs() >> bit & 1 == 1) == (step > 0) { '1' } else { '0' });
            }
            bits += if kind.is_progressive { "" } else { "0" };
        }
    }
    bits += &"1".repeat(bits.len().wrapping_neg() % 8);
    let bytes = (0..bits.len()).step_by(8).map(|at| u8::from_str_radix(&bits[at..at + 8], 2).unwrap());
    let data: Vec<u8> = bytes.flat_map(|byte| if byte == 0xff { vec![0xff, 0] } else { vec![byte] }).collect();
    [
        &[0xff, 0xd8][..],
        &adobe.unwrap_or_default(),
        &segment(0xdb, &factors),
        &segment(if kind.is_progressive { 0xc2 } else { 0xc0 }, &size),
        &segment(0xc4, &first),
        &segment(0xc4, &others),
        &segment(0xda, &scan),
        &data,
        &[0xff, 0xd9],
    ]
    .concat()
}

/// A lossless WebP file.
pub fn webp(width: u32, channels: image_webp::ColorType, bytes: &[u8]) -> Vec<u8> {
    let mut file = vec![];
    let size = if channels == image_webp::ColorType::Rgb8 { 3 } else { 4 };
    let height = bytes.len() as u32 / size / width;
    image_webp::WebPEncoder::new(&mut file).encode(bytes, width, height, channels).unwrap();
    file
}

/// Files of all kinds of PNG, and their texels.
fn pngs() -> Vec<(Vec<u8>, Vec<Texel>)> {
    let transparent = |channels: &[u16]| {
        vec![chunk(b"tRNS", &channels.iter().flat_map(|channel| channel.to_be_bytes()).collect::<Vec<u8>>())]
    };
    let palette = || chunk(b"PLTE", &[9, 8, 7, 50, 60, 70, 0, 255, 0]);
    let grey = |values: &[u8]| values.iter().map(|&l| [l, l, l, 255]).collect::<Vec<Texel>>();
    vec![
        (png([3, 1, 1, 0, 0], &[], &[0, 0b1010_0000]), grey(&[255, 0, 255])),
        (
            png([3, 1, 2, 0, 0], &transparent(&[2]), &[0, 0b0110_1100]),
            vec![[85, 85, 85, 255], [170, 170, 170, 0], [255; 4]],
        ),
        (png([2, 2, 4, 0, 0], &[], &[0, 0x1f, 0, 0xa0]), grey(&[17, 255, 170, 0])),
        (png([2, 1, 8, 0, 0], &[], &[0, 3, 200]), grey(&[3, 200])),
        (png([2, 1, 8, 4, 0], &[], &[0, 3, 200, 4, 0]), vec![[3, 3, 3, 200], [4, 4, 4, 0]]),
        (png([2, 1, 8, 2, 0], &transparent(&[4, 5, 6]), &[0, 1, 2, 3, 4, 5, 6]), vec![[1, 2, 3, 255], [4, 5, 6, 0]]),
        (png([1, 2, 8, 2, 0], &[], &[0, 1, 2, 3, 0, 4, 5, 6]), vec![[1, 2, 3, 255], [4, 5, 6, 255]]),
        (png([1, 1, 8, 6, 0], &[], &[0, 1, 2, 3, 4]), vec![[1, 2, 3, 4]]),
        // The second byte of two decides how the first is rounded.
        (png([3, 1, 16, 0, 0], &[], &[0, 0x80, 0, 0x80, 0xff, 0xff, 0xff]), grey(&[128, 128, 255])),
        (png([2, 1, 16, 0, 0], &transparent(&[300]), &[0, 1, 44, 1, 45]), vec![[1, 1, 1, 0], [1, 1, 1, 255]]),
        (png([1, 1, 16, 4, 0], &[], &[0, 0x10, 0x8f, 0x10, 0x90]), vec![[16, 16, 16, 16]]),
        (png([1, 1, 16, 2, 0], &[], &[0, 0, 127, 0, 129, 255, 0]), vec![[0, 1, 254, 255]]),
        (png([1, 1, 16, 6, 0], &[], &[0, 0, 127, 0, 129, 255, 0, 1, 1]), vec![[0, 1, 254, 1]]),
        (
            png([3, 1, 2, 3, 0], &[palette(), chunk(b"tRNS", &[77])], &[0, 0b0001_1000]),
            vec![[9, 8, 7, 77], [50, 60, 70, 255], [0, 255, 0, 255]],
        ),
        (png([2, 1, 8, 3, 0], &[palette()], &[0, 2, 1]), vec![[0, 255, 0, 255], [50, 60, 70, 255]]),
        // The pixels (0, 0), then (2, 0), then row 2 without its middle, then the rest of the rows 0 and 2, then row 1.
        (png([3, 3, 8, 0, 1], &[], &[0, 1, 0, 3, 0, 7, 9, 0, 2, 0, 8, 0, 4, 5, 6]), grey(&[1, 2, 3, 4, 5, 6, 7, 8, 9])),
    ]
}

/// Files of all kinds of JPEG, and the colours of their blocks.
fn jpegs() -> Vec<(Vec<u8>, Vec<[u8; 3]>)> {
    let greys = [[0], [255], [77]];
    let colors = [[128, 128, 128], [200, 90, 150], [30, 140, 120]];
    let inks = [[255, 128, 64, 255], [200, 255, 10, 100]];
    // With Cb = Cr = 128, each of C, M and Y is 255 - Y.
    let ycck = [[200, 128, 128, 255], [100, 128, 128, 51]];
    let grey = |values: &[u8]| values.iter().map(|&l| [l; 3]).collect::<Vec<_>>();
    let rgb = |[y, cb, cr]: [u8; 3]| {
        let [y, cb, cr] = [f64::from(y), f64::from(cb) - 128.0, f64::from(cr) - 128.0];
        [y + 1.402 * cr, y - 0.344_136 * cb - 0.714_136 * cr, y + 1.772 * cb].map(|channel| channel.round() as u8)
    };
    // Adobe's programs store 255 minus the ink. Black ink darkens the other three.
    let print = |[c, m, y, k]: [u8; 4]| [c, m, y].map(|ink| (u32::from(ink) * u32::from(k) / 255) as u8);
    let progressive = Jpeg { is_progressive: true, ..YCBCR };
    vec![
        (jpeg(YCBCR, &greys), grey(&[0, 255, 77])),
        (jpeg(progressive, &greys), grey(&[0, 255, 77])),
        (jpeg(YCBCR, &colors), colors.map(rgb).to_vec()),
        (jpeg(progressive, &colors), colors.map(rgb).to_vec()),
        (jpeg(Jpeg { ids: *b"RGB?", ..YCBCR }, &colors), colors.to_vec()),
        (jpeg(Jpeg { adobe: Some(0), ..YCBCR }, &inks), inks.map(print).to_vec()),
        (jpeg(Jpeg { adobe: Some(2), ..YCBCR }, &ycck), grey(&[55, 31])),
    ]
}

#[test]
fn pngs_of_all_kinds_are_read() {
    for (at, (file, texels)) in pngs().iter().enumerate() {
        assert_eq!(decoded(file).map(|(_, rgba)| rgba).as_ref(), Ok(texels), "kind {at}");
    }
}

#[test]
fn jpegs_of_all_kinds_are_read() {
    for (at, (file, colors)) in jpegs().iter().enumerate() {
        let (width, rgba) = decoded(file).unwrap();
        assert_eq!((width as usize, rgba.len()), (8 * colors.len(), 64 * colors.len()), "kind {at}");
        for (k, texel) in rgba.iter().enumerate() {
            let [r, g, b] = colors[k % width as usize / 8];
            let near = texel.iter().zip([r, g, b, 255]).all(|(a, b)| a.abs_diff(b) <= 1);
            assert!(near, "kind {at}, texel {k}: {texel:?}, not {:?}", [r, g, b]);
        }
    }
}

#[test]
fn webps_with_and_without_alpha_are_read() {
    use image_webp::ColorType::{Rgb8, Rgba8};
    let bytes: Vec<u8> = (0..24).map(|k| 10 * k).collect();
    let opaque = bytes.as_chunks::<3>().0.iter().map(|&[r, g, b]| [r, g, b, 255]).collect();
    assert_eq!(decoded(&webp(4, Rgb8, &bytes)), Ok((4, opaque)));
    assert_eq!(decoded(&webp(3, Rgba8, &bytes)), Ok((3, bytes.as_chunks::<4>().0.to_vec())));
}

#[test]
fn other_formats_and_sizes_are_refused_with_a_remedy() {
    for file in [
        &b"GIF89a\x01\0\x01\0"[..],
        b"BM",
        b"II*\0",
        b"#?RADIANCE\n\n-Y 1 +X 1\n\0\0\0\0",
        b"qoif",
        b"RIFF\0\0\0\0WAVE",
        b"",
    ] {
        let message = decoded(file).unwrap_err();
        let words = "its format is not read; re-export with PNG, JPEG or WebP textures";
        assert!(message.contains(words), "{message}");
    }
    let mut arithmetic = jpeg(YCBCR, &[[0]]);
    let at = arithmetic.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap();
    arithmetic[at + 1] = 0xc9;
    assert!(decoded(&arithmetic).unwrap_err().contains("this JPEG is damaged or unusual ("));
    // The size of a JPEG: after the length of its segment and the number of bits.
    let mut wide = jpeg(YCBCR, &[[0]]);
    wide[at + 7..at + 9].copy_from_slice(&16385u16.to_be_bytes());
    let message = decoded(&wide).unwrap_err();
    assert!(
        message.contains("it has 16385 x 8 pixels; save it as PNG, JPEG or WebP of at most 16384 x 16384"),
        "{message}"
    );
}

#[test]
fn files_that_end_too_early_are_refused_or_read_without_a_panic() {
    let files = pngs().into_iter().map(|(file, _)| file).chain(jpegs().into_iter().map(|(file, _)| file));
    for file in files.chain([webp(4, image_webp::ColorType::Rgb8, &[7; 24])]) {
        for end in 0..file.len() {
            let outcome = decoded(&file[..end]);
            assert!(!outcome.as_ref().is_err_and(|e| e.contains("reader failed")), "{end}: {outcome:?}");
            // JPEG files show what they have.
            let is_jpeg = file[0] == 0xff;
            assert!(outcome.is_err() || is_jpeg || end + 12 >= file.len(), "{end} of {} bytes were read", file.len());
        }
    }
}
