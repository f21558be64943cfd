//! Reads Radiance HDR images: a header of text, then rows of pixels. A pixel has four bytes: R, G, B and their common exponent.

use std::io::{self, BufRead, Read};

/// Maximum length of a line of the header in bytes.
const MAX_LINE: u64 = 1 << 16;

/// What the header says.
pub struct Header {
    pub width: u32,
    pub height: u32,
    /// By what the radiance in red, green and blue was multiplied: the product of all `EXPOSURE` and `COLORCORR`.
    pub factors: [f32; 3],
}

impl Header {
    /// Reads the header, up to the first row of pixels. The error is a clause that says what is wrong.
    pub fn read(file: &mut impl BufRead) -> Result<Header, String> {
        let signature = line(file)?;
        if !signature.starts_with("#?RADIANCE") && !signature.starts_with("#?RGBE") {
            return Err("it does not begin with `#?RADIANCE` or `#?RGBE`".into());
        }
        let (mut exposure, mut correction) = (1.0, [1.0; 3]);
        loop {
            let line = line(file)?;
            if line.is_empty() {
                break;
            }
            let Some((key, value)) = line.split_once('=').filter(|_| !line.starts_with('#')) else { continue };
            let numbers = || value.split_whitespace().map(str::parse).collect::<Result<Vec<f32>, _>>();
            match key.trim() {
                "FORMAT" if value.trim() != "32-bit_rle_rgbe" => return Err(unread(&line)),
                "EXPOSURE" => match numbers().as_deref() {
                    Ok([factor]) => exposure *= factor,
                    _ => return Err(unread(&line)),
                },
                "COLORCORR" => match numbers().as_deref() {
                    Ok([r, g, b]) => correction = [correction[0] * r, correction[1] * g, correction[2] * b],
                    _ => return Err(unread(&line)),
                },
                _ => {}
            }
        }
        let line = line(file)?;
        let size = match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["-Y", height, "+X", width] => width.parse().ok().zip(height.parse().ok()),
            _ => None,
        };
        let (width, height) = size.ok_or_else(|| unread(&line))?;
        Ok(Header { width, height, factors: correction.map(|factor| factor * exposure) })
    }
}

fn unread(line: &str) -> String {
    format!("its line `{}` is not read", line.chars().take(60).flat_map(char::escape_debug).collect::<String>())
}

/// The next line of the header, without its end.
fn line(file: &mut impl BufRead) -> Result<String, String> {
    let mut line = vec![];
    file.take(MAX_LINE).read_until(b'\n', &mut line).map_err(|e| e.to_string())?;
    match line.pop() {
        Some(b'\n') => Ok(String::from_utf8_lossy(&line).into_owned()),
        _ => Err("a line of its header does not end".into()),
    }
}

/// Reads the rows below the header into `rgb`, a whole number of rows. The values are not divided by the factors of the header.
pub fn read_rows(file: &mut impl Read, width: u32, rgb: &mut [[f32; 3]]) -> io::Result<()> {
    let mut row = vec![[0; 4]; width as usize];
    for rgb in rgb.chunks_exact_mut(row.len()) {
        match bytes(file)? {
            // No program writes such a pixel, because one of R, G and B is above 127. It announces four rows of bytes.
            [2, 2, 0..128, _] => (0..4).try_for_each(|channel| read_channel(file, &mut row, channel))?,
            first => read_pixels(file, &mut row, first)?,
        }
        for (rgb, &[r, g, b, exponent]) in rgb.iter_mut().zip(&row) {
            let unit = if exponent == 0 { 0.0 } else { libm::ldexpf(1.0, i32::from(exponent) - 136) };
            *rgb = [r, g, b].map(|channel| unit * f32::from(channel));
        }
    }
    Ok(())
}

/// Reads one of the four bytes of all pixels: runs of equal bytes, and lists of bytes.
fn read_channel(file: &mut impl Read, row: &mut [[u8; 4]], channel: usize) -> io::Result<()> {
    let mut at = 0;
    while at < row.len() {
        let [count] = bytes(file)?;
        let run: Option<[u8; 1]> = if count > 128 { Some(bytes(file)?) } else { None };
        let count = usize::from(if count > 128 { count - 128 } else { count });
        for pixel in row.get_mut(at..at + count).ok_or_else(too_long)? {
            [pixel[channel]] = run.map_or_else(|| bytes(file), Ok)?;
        }
        at += count;
    }
    Ok(())
}

/// Reads pixels after the `first` one. The pixel 1, 1, 1, n repeats the pixel before it n times. The next such pixel counts 256 times
/// as much, and so on.
fn read_pixels(file: &mut impl Read, row: &mut [[u8; 4]], first: [u8; 4]) -> io::Result<()> {
    let (mut at, mut shift, mut pixel) = (0, 0, first);
    loop {
        let (count, value) = match (pixel, row[..at].last()) {
            ([1, 1, 1, count], Some(last)) => (usize::from(count) << shift, *last),
            ([1, 1, 1, _], None) => return Err(io::Error::other("a row begins with a repetition")),
            (pixel, _) => (1, pixel),
        };
        row.get_mut(at..at + count).ok_or_else(too_long)?.fill(value);
        shift = if pixel[..3] == [1; 3] { 24.min(shift + 8) } else { 0 };
        at += count;
        if at == row.len() {
            return Ok(());
        }
        pixel = bytes(file)?;
    }
}

fn bytes<const N: usize>(file: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    file.read_exact(&mut bytes).map(|()| bytes)
}

fn too_long() -> io::Error {
    io::Error::other("a row is longer than the image is wide")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads rows of `width` pixels.
    fn rows(width: u32, height: usize, bytes: &[u8]) -> Result<Vec<[f32; 3]>, String> {
        let mut rgb = vec![[-1.0; 3]; width as usize * height];
        let mut rest = bytes;
        read_rows(&mut rest, width, &mut rgb).map_err(|e| e.to_string())?;
        assert!(rest.is_empty(), "{} bytes are left", rest.len());
        Ok(rgb)
    }

    #[test]
    fn a_pixel_is_its_bytes_times_a_power_of_two() {
        for exponent in 1..=255u8 {
            let unit = 2f64.powi(i32::from(exponent) - 136);
            let exact = [255.0, 128.0, 1.0].map(|channel| (channel * unit) as f32);
            assert_eq!(rows(1, 1, &[255, 128, 1, exponent]), Ok(vec![exact]), "{exponent}");
        }
        assert_eq!(rows(1, 1, &[255, 128, 1, 0]), Ok(vec![[0.0; 3]]));
    }

    #[test]
    fn rows_are_flat_or_have_runs_of_bytes_or_of_pixels() {
        let (a, b) = ([1.0, 2.0, 3.0], [128.0, 0.0, 255.0]);
        let flat = [1, 2, 3, 136, 1, 2, 3, 136, 1, 2, 3, 136, 128, 0, 255, 136];
        let of_bytes = [2, 2, 0, 4, 131, 1, 1, 128, 3, 2, 2, 2, 129, 0, 131, 3, 1, 255, 132, 136];
        let of_pixels = [1, 2, 3, 136, 1, 1, 1, 2, 128, 0, 255, 136];
        let all = [&flat[..], &of_bytes, &of_pixels].concat();
        assert_eq!(rows(4, 3, &all), Ok([a, a, a, b].repeat(3)));
        // 2 + 256 repetitions; a pixel between two repetitions ends their number.
        let long = [1, 2, 3, 136, 1, 1, 1, 2, 1, 1, 1, 1, 128, 0, 255, 136, 1, 1, 1, 1];
        assert_eq!(rows(261, 1, &long), Ok([vec![a; 259], vec![b; 2]].concat()));
    }

    #[test]
    fn damaged_rows_are_refused() {
        let long = "a row is longer than the image is wide";
        for (bytes, message) in [
            (&[2, 2, 0, 4, 133, 1][..], long),
            (&[2, 2, 0, 4, 3, 9, 9, 9, 2, 9, 9], long),
            (&[1, 2, 3, 136, 1, 1, 1, 4], long),
            (&[1, 2, 3, 136, 1, 1, 1, 0, 1, 1, 1, 0, 1, 1, 1, 0, 1, 1, 1, 0, 1, 1, 1, 255], long),
            (&[1, 1, 1, 1], "a row begins with a repetition"),
        ] {
            assert_eq!(rows(4, 1, bytes), Err(message.into()), "{bytes:?}");
        }
        let whole = [2, 2, 0, 4, 131, 1, 1, 128, 132, 2, 132, 0, 132, 136];
        assert!(rows(4, 1, &whole).is_ok());
        for end in 0..whole.len() {
            assert!(rows(4, 1, &whole[..end]).is_err(), "{end} bytes");
        }
    }

    #[test]
    fn the_header_has_a_size_and_factors() {
        let read = |text: &str| {
            let mut rest = text.as_bytes();
            Header::read(&mut rest).map(|Header { width, height, factors }| (width, height, factors, rest.len()))
        };
        let good = "#?RADIANCE by hand\n# EXPOSURE=9\nrpict -vp 0 0 1\nSOFTWARE= any=one\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\
            COLORCORR=1 2 4\n EXPOSURE = 0.25\n\n-Y 3 +X 5\npixels";
        assert_eq!(read(good), Ok((5, 3, [0.5, 1.0, 2.0], 6)));
        for line in [
            "FORMAT=32-bit_rle_xyze",
            "EXPOSURE=bright",
            "EXPOSURE=",
            "COLORCORR=1 2",
            "COLORCORR=1 2 3 4",
            "\n+X 5 -Y 3",
            "\n-Y 3 +X -5",
            "\n-Y 4294967296 +X 5",
        ] {
            let message = read(&format!("#?RGBE\n{line}\n")).unwrap_err();
            assert!(message.contains(&format!("its line `{}` is not read", line.trim())), "{message}");
        }
        assert!(read("#?RGBE\n\n-Y 3 +X 5").unwrap_err().contains("does not end"));
        assert!(read(&format!("#?RGBE\n{}", "x".repeat(1 << 17))).unwrap_err().contains("does not end"));
        assert!(read("GIF89a\n").unwrap_err().contains("does not begin with"));
    }
}
