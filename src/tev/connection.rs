//! A connection to a tev: sends the tiles of a snapshot that changed.

use std::hash::{DefaultHasher, Hasher};
use std::io::{Error, ErrorKind, Result, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use crate::image::channels::ChannelGroup;
use crate::settings::tev::TevAddress;
use crate::tev::Snapshot;
use crate::tev::packets::{Packet, Rectangle};

/// Side of a tile in pixels. A packet with three channels has about 200 kB.
const TILE: u32 = 128;
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);
/// Maximum time during which tev may accept no data.
const WRITE_TIMEOUT: Duration = Duration::from_secs(10);

pub struct Connection {
    stream: TcpStream,
    packet: Packet,
    /// Name, size and channels of the image that tev has.
    image: Option<Snapshot>,
    /// Hashes of the packets that tev has, for each group and tile.
    sent: Vec<Option<u64>>,
}

impl Connection {
    /// Connects to the first address of the host that answers.
    pub fn open(address: &TevAddress) -> Result<Connection> {
        let mut failure = Error::new(ErrorKind::NotFound, "the host has no address");
        for address in address.as_pair().to_socket_addrs()? {
            match TcpStream::connect_timeout(&address, CONNECT_TIMEOUT) {
                Ok(stream) => {
                    stream.set_write_timeout(Some(WRITE_TIMEOUT))?;
                    stream.set_nodelay(true)?;
                    return Ok(Connection { stream, packet: Packet::default(), image: None, sent: vec![] });
                }
                Err(error) => failure = error,
            }
        }
        Err(failure)
    }

    /// Sends what changed since the last call. Stops early if `is_stale`; the next call then sends the rest.
    pub fn send(&mut self, snapshot: &Snapshot, is_stale: impl Fn() -> bool) -> Result<()> {
        self.check_open()?;
        let Snapshot { name, width, height, groups } = snapshot;
        let pixels = *width as usize * *height as usize;
        if groups.iter().any(|group| group.names.is_empty() || group.values.len() != pixels * group.names.len()) {
            return Err(Error::new(ErrorKind::InvalidInput, "the image is not complete"));
        }
        let tiles = tiles(*width, *height);
        self.create(snapshot, tiles.len() * groups.len())?;
        for (group, sent) in groups.iter().zip(self.sent.chunks_mut(tiles.len().max(1))) {
            let channels: Vec<&str> = group.names.iter().map(String::as_str).collect();
            for (tile, sent) in tiles.iter().zip(sent) {
                if is_stale() {
                    return Ok(());
                }
                let packet = self.packet.update_image(name, &channels, *tile, rows(group, *width, *tile))?;
                let mut hasher = DefaultHasher::new();
                hasher.write(packet);
                let hash = Some(hasher.finish());
                if *sent != hash {
                    self.stream.write_all(packet)?;
                    *sent = hash;
                }
            }
        }
        Ok(())
    }

    /// Creates the image in tev, unless tev has an image of this name, size and channels. `count`: the number of groups times tiles.
    fn create(&mut self, snapshot: &Snapshot, count: usize) -> Result<()> {
        let empty = |group: &ChannelGroup| ChannelGroup { names: group.names.clone(), values: vec![] };
        let groups = snapshot.groups.iter().map(empty).collect();
        let image = Snapshot { name: snapshot.name.clone(), groups, ..*snapshot };
        if self.image.as_ref() != Some(&image) {
            let channels: Vec<&str> = image.groups.iter().flat_map(|group| &group.names).map(String::as_str).collect();
            let packet = self.packet.create_image(&image.name, [image.width, image.height], &channels)?;
            self.stream.write_all(packet)?;
            (self.image, self.sent) = (Some(image), vec![None; count]);
        }
        Ok(())
    }

    /// Fails if tev has closed the connection. The first write after that would seem to succeed.
    fn check_open(&self) -> Result<()> {
        self.stream.set_nonblocking(true)?;
        let peeked = self.stream.peek(&mut [0]);
        self.stream.set_nonblocking(false)?;
        match peeked {
            Ok(0) => Err(Error::new(ErrorKind::ConnectionAborted, "it closed the connection")),
            Err(error) if error.kind() != ErrorKind::WouldBlock => Err(error),
            _ => Ok(()),
        }
    }
}

/// The tiles of an image, row by row.
fn tiles(width: u32, height: u32) -> Vec<Rectangle> {
    let starts = |side: u32| (0..side).step_by(TILE as usize);
    let tile = |x, y| Rectangle { x, y, width: TILE.min(width - x), height: TILE.min(height - y) };
    starts(height).flat_map(|y| starts(width).map(move |x| tile(x, y))).collect()
}

/// The values of a tile, row by row. `width` is that of the image.
fn rows(group: &ChannelGroup, width: u32, tile: Rectangle) -> impl Iterator<Item = &[f32]> {
    let channels = group.names.len();
    let [width, x, columns] = [width, tile.x, tile.width].map(|count| count as usize * channels);
    (tile.y..tile.y + tile.height).map(move |y| &group.values[y as usize * width + x..][..columns])
}
