//! A stand-in for tev: reads the packets of a client as tev's protocol describes them, and keeps the images. It shares no code with the
//! client, and refuses everything that tev would refuse.

use std::collections::BTreeMap;
use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::thread::{JoinHandle, spawn};

/// Maximum size of a packet in bytes: tev's buffer, which grows beyond that only for single large packets.
const MAX_PACKET: usize = 1 << 20;

pub struct Image {
    pub width: usize,
    pub height: usize,
    pub channels: BTreeMap<String, Vec<f32>>,
    /// How often it was updated: channels, and x, y, width, height of the tile.
    pub updates: Vec<(Vec<String>, [usize; 4])>,
}

#[derive(Default)]
pub struct Viewer {
    pub images: BTreeMap<String, Image>,
    /// Names of the images, in the order in which they were created.
    pub created: Vec<String>,
}

/// A socket for clients on this machine, and its address.
pub fn listen() -> (TcpListener, String) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    (listener, address)
}

/// Shows what one client sends, until it closes the connection.
pub fn show(listener: TcpListener) -> JoinHandle<Viewer> {
    spawn(move || {
        let mut viewer = Viewer::default();
        let mut stream = listener.accept().unwrap().0;
        while let Some(packet) = read_packet(&mut stream) {
            viewer.take(&packet);
        }
        viewer
    })
}

/// The next packet without its length; `None` at the end.
pub fn read_packet(stream: &mut TcpStream) -> Option<Vec<u8>> {
    let mut length = [0; 4];
    // A client that is killed may end within a packet.
    stream.read_exact(&mut length).ok()?;
    let length = u32::from_le_bytes(length) as usize;
    assert!((5..=MAX_PACKET).contains(&length), "a packet of {length} bytes");
    let mut packet = vec![0; length - 4];
    stream.read_exact(&mut packet).ok()?;
    Some(packet)
}

impl Viewer {
    fn take(&mut self, packet: &[u8]) {
        let mut fields = Fields(packet);
        match fields.byte() {
            4 => self.create(&mut fields),
            6 => self.update(&mut fields),
            other => panic!("operation {other}"),
        }
        assert!(fields.0.is_empty(), "{} bytes after the packet", fields.0.len());
    }

    fn create(&mut self, fields: &mut Fields) {
        assert_eq!(fields.byte(), 1, "a new image is selected");
        let name = fields.text();
        let [width, height, count] = [(); 3].map(|()| fields.int());
        let channels = (0..count).map(|_| (fields.text(), vec![0.0; width * height])).collect::<BTreeMap<_, _>>();
        assert_eq!(channels.len(), count, "two channels have one name");
        self.created.push(name.clone());
        self.images.insert(name, Image { width, height, channels, updates: vec![] });
    }

    fn update(&mut self, fields: &mut Fields) {
        assert_eq!(fields.byte(), 0, "an update does not select the image");
        let name = fields.text();
        let count = fields.int();
        let names: Vec<String> = (0..count).map(|_| fields.text()).collect();
        let [x, y, width, height] = [(); 4].map(|()| fields.int());
        let offsets: Vec<usize> = (0..count).map(|_| fields.long()).collect();
        let strides: Vec<usize> = (0..count).map(|_| fields.long()).collect();
        let needed = offsets.iter().zip(&strides).map(|(offset, stride)| offset + (width * height - 1) * stride + 1);
        let values: Vec<f32> = (0..needed.max().unwrap()).map(|_| f32::from_le_bytes(fields.bytes())).collect();

        let image = self.images.get_mut(&name).unwrap_or_else(|| panic!("{name} was not created"));
        assert!(x + width <= image.width && y + height <= image.height, "{name}: a tile outside the image");
        for (name, (offset, stride)) in names.iter().zip(offsets.iter().zip(&strides)) {
            let channel = image.channels.get_mut(name).unwrap_or_else(|| panic!("no channel {name}"));
            for pixel in 0..width * height {
                let at = (y + pixel / width) * image.width + x + pixel % width;
                channel[at] = values[offset + pixel * stride];
            }
        }
        image.updates.push((names, [x, y, width, height]));
    }
}

/// The bytes of a packet that are not read yet.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (bytes, rest) = self.0.split_first_chunk().expect("the packet is too short");
        self.0 = rest;
        *bytes
    }

    fn byte(&mut self) -> u8 {
        self.bytes::<1>()[0]
    }

    fn int(&mut self) -> usize {
        i32::from_le_bytes(self.bytes()).try_into().expect("a negative number")
    }

    fn long(&mut self) -> usize {
        i64::from_le_bytes(self.bytes()).try_into().expect("a negative number")
    }

    fn text(&mut self) -> String {
        let end = self.0.iter().position(|&byte| byte == 0).expect("a text without end");
        let text = String::from_utf8(self.0[..end].to_vec()).unwrap();
        self.0 = &self.0[end + 1..];
        text
    }
}
