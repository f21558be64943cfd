//! The packets of tev's protocol that create and update images. All numbers are little-endian. A packet begins with its own length in
//! bytes (u32) and a byte for the operation; texts end with a zero byte. tev answers nothing.

use std::io::{Error, ErrorKind, Result};

const CREATE_IMAGE: u8 = 4;
const UPDATE_IMAGE_V3: u8 = 6;

/// A part of an image: column and row of its first pixel, and its size in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rectangle {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

/// Makes packets. Each packet reuses the memory of the one before. The methods fail if the image is too large for the numbers of the
/// protocol.
#[derive(Default)]
pub struct Packet {
    bytes: Vec<u8>,
}

impl Packet {
    /// Creates a black image, which replaces an image of the same name, and selects it in tev.
    pub fn create_image(&mut self, name: &str, [width, height]: [u32; 2], channels: &[&str]) -> Result<&[u8]> {
        self.begin(CREATE_IMAGE);
        self.flag(true);
        self.text(name);
        self.integer(width)?;
        self.integer(height)?;
        self.channels(channels)?;
        self.end()
    }

    /// Replaces some channels in a part of an image, without selecting it. `rows` are the rows of that part, each with the values of
    /// its pixels: one per channel.
    pub fn update_image<'a>(
        &mut self,
        name: &str,
        channels: &[&str],
        part: Rectangle,
        rows: impl Iterator<Item = &'a [f32]>,
    ) -> Result<&[u8]> {
        self.begin(UPDATE_IMAGE_V3);
        self.flag(false);
        self.text(name);
        self.channels(channels)?;
        for number in [part.x, part.y, part.width, part.height] {
            self.integer(number)?;
        }
        // Offset of the first value of each channel, then the stride from pixel to pixel.
        (0..channels.len()).for_each(|offset| self.long(offset));
        channels.iter().for_each(|_| self.long(channels.len()));
        for row in rows {
            self.bytes.extend(row.iter().flat_map(|value| value.to_le_bytes()));
        }
        self.end()
    }

    fn begin(&mut self, operation: u8) {
        self.bytes.clear();
        self.bytes.extend([0; 4]);
        self.bytes.push(operation);
    }

    fn flag(&mut self, flag: bool) {
        self.bytes.push(flag.into());
    }

    fn text(&mut self, text: &str) {
        // A zero byte would end the text.
        self.bytes.extend(text.replace('\0', "\u{fffd}").bytes());
        self.bytes.push(0);
    }

    fn integer(&mut self, number: impl TryInto<i32>) -> Result<()> {
        let number: i32 = number.try_into().map_err(|_| too_large())?;
        self.bytes.extend(number.to_le_bytes());
        Ok(())
    }

    fn long(&mut self, number: usize) {
        self.bytes.extend((number as i64).to_le_bytes());
    }

    fn channels(&mut self, names: &[&str]) -> Result<()> {
        self.integer(names.len())?;
        names.iter().for_each(|name| self.text(name));
        Ok(())
    }

    fn end(&mut self) -> Result<&[u8]> {
        let length = u32::try_from(self.bytes.len()).map_err(|_| too_large())?;
        self.bytes[..4].copy_from_slice(&length.to_le_bytes());
        Ok(&self.bytes)
    }
}

fn too_large() -> Error {
    Error::new(ErrorKind::InvalidInput, "the image is too large for tev")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn creating_an_image_has_the_bytes_of_tevs_own_client() {
        let mut packet = Packet::default();
        let bytes = packet.create_image("gate", [8, 4], &["R", "G", "B"]).unwrap();
        let golden = b"\x1d\0\0\0\x04\x01gate\0\x08\0\0\0\x04\0\0\0\x03\0\0\0R\0G\0B\0";
        assert_eq!(bytes, golden);
        let bytes = packet.create_image("a\0b", [1, 1], &["Z"]).unwrap();
        assert_eq!(bytes[6..12], *b"a\xef\xbf\xbdb\0");
        assert!(packet.create_image("gate", [1 << 31, 4], &["Z"]).is_err());
    }

    #[test]
    fn updates_are_interleaved() {
        let mut packet = Packet::default();
        let part = Rectangle { x: 5, y: 6, width: 2, height: 1 };
        let bytes = packet.update_image("i", &["A", "B"], part, [&[1.0, -2.0, 0.0, f32::MAX][..]].into_iter()).unwrap();
        let golden = b"\x50\0\0\0\x06\0i\0\x02\0\0\0A\0B\0\x05\0\0\0\x06\0\0\0\x02\0\0\0\x01\0\0\0\
                       \0\0\0\0\0\0\0\0\x01\0\0\0\0\0\0\0\x02\0\0\0\0\0\0\0\x02\0\0\0\0\0\0\0\
                       \0\0\x80\x3f\0\0\0\xc0\0\0\0\0\xff\xff\x7f\x7f";
        assert_eq!(bytes, golden);
    }
}
