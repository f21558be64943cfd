//! All readers of files, as functions of bytes: for the fuzzer (`fuzz/run`) and for the test of its corpus (`tests/corpus.rs`).

use std::cell::LazyCell;
use std::io::Cursor;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::json;
use taugate::Scene;
use taugate::internals::image::accumulation::file::{read_from, write_to};
use taugate::internals::image::{exr_file, exr_header, exr_responses, npy_read};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::outputs;
use taugate::internals::input::scenery;
use taugate::internals::scene::{gltf, grid};

use crate::memory::peak_of;

/// Longest time that a reader may take for a file of the corpus or of the fuzzer.
const MAX_TIME: Duration = Duration::from_secs(60);
/// Bytes of memory that a reader may take whatever the length of the file.
const FREE_BYTES: usize = 256 << 20;
/// Bytes of memory that a reader may take for each byte of the file, beyond [`FREE_BYTES`].
const BYTES_PER_BYTE: usize = 20;
/// Like [`BYTES_PER_BYTE`], for readers of images. Images may take 4128 bytes per byte of their files. In addition, four bytes of a
/// WebP image can declare a Huffman table of 4 KiB.
const IMAGE_BYTES_PER_BYTE: usize = 6000;

/// A reader of a kind of file. A new format is one more entry in [`READERS`].
pub struct Reader {
    /// Name of the target, and of the folder of its corpus.
    pub name: &'static str,
    bytes_per_byte: usize,
    read: fn(&[u8]),
}

pub const READERS: &[Reader] = &[
    reader("gltf", IMAGE_BYTES_PER_BYTE, gltf),
    reader("image", IMAGE_BYTES_PER_BYTE, image),
    reader("draco", BYTES_PER_BYTE, draco),
    reader("meshopt", BYTES_PER_BYTE, meshopt),
    reader("experiment", BYTES_PER_BYTE, experiment),
    reader("exr", BYTES_PER_BYTE, exr),
    reader("npy", BYTES_PER_BYTE, npy),
    reader("hdr", IMAGE_BYTES_PER_BYTE, hdr),
    reader("vol", BYTES_PER_BYTE, vol),
    reader("grid_npy", BYTES_PER_BYTE, grid_npy),
    reader("response_csv", BYTES_PER_BYTE, response_csv),
    reader("phase_csv", BYTES_PER_BYTE, phase_csv),
    reader("acc", BYTES_PER_BYTE, acc),
    reader("acc_about", BYTES_PER_BYTE, acc_about),
];

const fn reader(name: &'static str, bytes_per_byte: usize, read: fn(&[u8])) -> Reader {
    Reader { name, bytes_per_byte, read }
}

impl Reader {
    /// Reads `bytes`. Panics if the reader does, if it takes more than a minute, or if it allocates more than [`FREE_BYTES`] and
    /// `bytes_per_byte` for each byte of the file.
    pub fn check(&self, bytes: &[u8]) {
        let start = Instant::now();
        let peak = peak_of(|| (self.read)(bytes));
        let time = start.elapsed();
        assert!(time < MAX_TIME, "{}: a file of {} bytes takes {time:?}", self.name, bytes.len());
        let limit = self.bytes_per_byte * bytes.len() + FREE_BYTES;
        assert!(peak <= limit, "{}: a file of {} bytes takes {peak} bytes of memory", self.name, bytes.len());
    }
}

/// Reads a scene. The reader turns a panic into an error; this function turns that error back into a panic.
fn load(bytes: &[u8]) {
    if let Err(error) = gltf::load_slice(bytes, Path::new("fuzz.glb")) {
        assert!(!error.to_string().contains("reader failed"), "the reader panicked");
    }
}

/// The bytes of a `.glb` file, or the text of a `.gltf` file.
fn gltf(bytes: &[u8]) {
    load(bytes);
}

/// Reads a scene with this JSON chunk, whose buffer is `bytes`.
fn load_with(mut json: serde_json::Value, bytes: &[u8]) {
    json["asset"] = json!({ "version": "2.0" });
    json["buffers"] = json!([{ "byteLength": bytes.len() }]);
    json["nodes"] = json!([{ "mesh": 0 }]);
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut data = bytes.to_vec();
    data.resize(data.len().next_multiple_of(4), 0);
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((28 + text.len() as u32 + data.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &data)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    load(&file);
}

/// A PNG, JPEG or WebP image, as the texture of a triangle.
fn image(bytes: &[u8]) {
    let accessor = |shape: &str| json!({ "componentType": 5126, "type": shape, "count": 3 });
    let json = json!({
        "accessors": [accessor("VEC3"), accessor("VEC2")],
        "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
        "images": [{ "bufferView": 0, "mimeType": "image/png" }],
        "textures": [{ "source": 0 }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": 0 }] }],
    });
    load_with(json, bytes);
}

/// Draco data of a mesh with positions, normals and texture coordinates. The first byte is the number of vertices. The next two
/// bytes are the number of corners, low byte first.
fn draco(bytes: &[u8]) {
    let Some((&[count, low, high], bytes)) = bytes.split_first_chunk() else { return };
    let accessor = |shape: &str| json!({ "componentType": 5126, "type": shape, "count": count });
    let attributes = json!({ "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 });
    let json = json!({
        "accessors": [accessor("VEC3"), accessor("VEC3"), accessor("VEC2"),
            { "componentType": 5123, "type": "SCALAR", "count": u16::from_le_bytes([low, high]) }],
        "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
        "extensionsUsed": ["KHR_draco_mesh_compression"],
        "extensionsRequired": ["KHR_draco_mesh_compression"],
        "meshes": [{ "primitives": [{ "attributes": attributes, "indices": 3, "extensions": {
            "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": attributes } } }] }],
    });
    load_with(json, bytes);
}

/// Meshopt data. The first three bytes are the mode and filter, the stride in words, and the number of elements.
fn meshopt(bytes: &[u8]) {
    let Some((&[kind, stride, count], bytes)) = bytes.split_first_chunk() else { return };
    let mode = ["ATTRIBUTES", "TRIANGLES", "INDICES"][usize::from(kind % 3)];
    let filter = ["NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"][usize::from(kind / 3 % 4)];
    let (stride, count) = (4 * (u64::from(stride) % 65), u64::from(count));
    let length = stride * count;
    let json = json!({
        "accessors": [{ "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": count }],
        "bufferViews": [{ "buffer": 0, "byteLength": length, "byteStride": stride, "extensions": {
            "EXT_meshopt_compression": { "buffer": 0, "byteLength": bytes.len(), "byteStride": stride, "count": count,
                "mode": mode, "filter": filter } } }],
        "extensionsUsed": ["EXT_meshopt_compression"],
        "extensionsRequired": ["EXT_meshopt_compression"],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
    });
    load_with(json, bytes);
}

/// An experiment file, with its tables of lights and of a scan. Writes the experiment and reads it again.
fn experiment(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(experiment) = Experiment::parse(text) else { return };
    for (i, light) in experiment.light.iter().enumerate() {
        let _ = light.light(i + 1);
    }
    if let Some(Ok(scan)) = experiment.scan.as_ref().map(|scan| scan.scan()) {
        let _ = (scan.light(0), scan.camera(0));
    }
    let again = experiment.to_toml();
    assert!(Experiment::parse(&again).is_ok(), "this experiment was written, but cannot be read again:\n{again}");
}

/// Calls `read` with the path of a temporary file that contains `bytes`. The file is in memory if possible.
fn with_file<T>(name: &str, bytes: &[u8], read: impl FnOnce(&Path) -> T) -> T {
    thread_local! {
        static FOLDER: LazyCell<tempfile::TempDir> = LazyCell::new(|| {
            let memory = Path::new("/dev/shm");
            let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
            folder.expect("a temporary folder")
        });
    }
    FOLDER.with(|folder| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("a temporary file");
        read(&path)
    })
}

/// An image that `compare` reads.
fn exr(bytes: &[u8]) {
    with_file("a.exr", bytes, |path| {
        let _ = exr_header::read_settings(path);
        let _ = exr_file::read_picture(path);
        let _ = exr_responses::read(path);
    });
}

/// An array that `compare` or `detect` reads.
fn npy(bytes: &[u8]) {
    with_file("a.npy", bytes, |path| drop(npy_read::read(path)));
}

/// The image of a sky, in Radiance HDR.
fn hdr(bytes: &[u8]) {
    with_file("sky.hdr", bytes, |path| {
        let _ = scenery::apply(&mut experiment_with("emitter.sky = 'FILE'", path), &mut Scene::default());
    });
}

fn vol(bytes: &[u8]) {
    with_file("a.vol", bytes, |path| drop(grid::load(path, None)));
}

fn grid_npy(bytes: &[u8]) {
    let bounds = Some([taugate::glam::DVec3::ZERO, taugate::glam::DVec3::ONE]);
    with_file("grid.npy", bytes, |path| drop(grid::load(path, bounds)));
}

/// Parses `line` as an experiment, with `path` in place of `FILE`.
fn experiment_with(line: &str, path: &Path) -> Experiment {
    Experiment::parse(&line.replace("FILE", path.to_str().expect("a plain path"))).expect("a good experiment")
}

fn response_csv(bytes: &[u8]) {
    with_file("a.csv", bytes, |path: &Path| {
        let _ = outputs(&experiment_with("[gate]\nresponse = ['FILE']\n[output]\noutput = 'a.npy'", path));
    });
}

fn phase_csv(bytes: &[u8]) {
    with_file("a.csv", bytes, |path: &Path| {
        let mut experiment = experiment_with("[medium]\nsigma_s = 1\nphase = 'FILE'", path);
        let _ = scenery::apply(&mut experiment, &mut Scene::default());
    });
}

/// The sums of a render. Writes the sums and reads them again.
fn acc(bytes: &[u8]) {
    let Ok(sums) = read_from(&mut Cursor::new(bytes)) else { return };
    let mut again = Cursor::new(vec![]);
    write_to(&mut again, sums.parts()).expect("memory takes all bytes");
    assert!(read_from(&mut again).is_ok(), "sums that were read are written as a wrong file");
}

/// An accumulation whose `about.json` is `bytes`, with the right checksums: a fuzzer cannot guess checksums.
fn acc_about(bytes: &[u8]) {
    const GOOD: &[u8] = include_bytes!("../../fuzz/corpus/acc/single");
    let mut zip = zip::ZipArchive::new(Cursor::new(GOOD)).expect("the corpus has whole files");
    let mut file = zip::ZipWriter::new(Cursor::new(vec![]));
    let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for i in 0..zip.len() {
        let mut entry = zip.by_index(i).expect("an entry");
        let name = entry.name().expect("a name").into_owned();
        let mut contents = vec![];
        std::io::Read::read_to_end(&mut entry, &mut contents).expect("its contents");
        file.start_file(&name, options).expect("a small file");
        let contents = if name == "about.json" { bytes } else { &contents };
        std::io::Write::write_all(&mut file, contents).expect("memory takes all bytes");
    }
    acc(&file.finish().expect("a small file").into_inner());
}
