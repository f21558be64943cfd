use super::*;

const BOUNDS: [DVec3; 2] = [DVec3::ZERO, DVec3::ONE];

fn vol(resolution: [i32; 3], bounds: [f32; 6], density: &[f32]) -> Vec<u8> {
    let mut bytes = b"VOL\x03".to_vec();
    let [nx, ny, nz] = resolution;
    bytes.extend([1, nx, ny, nz, 1].into_iter().flat_map(i32::to_le_bytes));
    bytes.extend(bounds.iter().chain(density).flat_map(|x| x.to_le_bytes()));
    bytes
}

fn npy(header: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes().chain(data.iter().copied()));
    bytes
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// The result of [`load`] for a file with this name and these bytes.
fn load_bytes(name: &str, bytes: &[u8], bounds: Option<[DVec3; 2]>) -> Result<DensityGrid> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    load(&path, bounds)
}

const HEADER: &str = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 3, 2), }          \n";

#[test]
fn both_formats_give_the_same_grid() {
    let density = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
    let grid = load_bytes("a.vol", &vol([2, 3, 1], [-1.0, -2.0, -3.0, 1.0, 2.0, 3.0], &density), None).unwrap();
    assert_eq!((grid.resolution, grid.density.as_slice()), ([2, 3, 1], &density[..]));
    let bounds = [DVec3::new(-1.0, -2.0, -3.0), DVec3::new(1.0, 2.0, 3.0)];
    assert_eq!(grid.bounds, bounds);
    assert_eq!(load_bytes("a.npy", &npy(HEADER, &floats(&density)), Some(bounds)).unwrap(), grid);
    let wide: Vec<u8> = density.iter().flat_map(|&x| f64::from(x).to_le_bytes()).collect();
    let header = "{'shape': (1, 3, 2, 1), 'fortran_order': False, 'descr': '<f8'}";
    assert_eq!(load_bytes("a.NPY", &npy(header, &wide), Some(bounds)).unwrap(), grid);
    // Given bounds replace those of the file.
    let other = load_bytes("a.vol", &vol([2, 3, 1], [0.0; 6], &density), Some(BOUNDS)).unwrap();
    assert_eq!(other.bounds, BOUNDS);
}

#[test]
fn bad_files_are_refused_with_one_sentence() {
    let ones = floats(&[1.0; 6]);
    let good = vol([2, 3, 1], [0.0, 0.0, 0.0, 1.0, 1.0, 1.0], &[1.0; 6]);
    let changed = |at: usize, byte: u8| {
        let mut bytes = good.clone();
        bytes[at] = byte;
        bytes
    };
    let unit = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
    let shaped = |shape: &str| npy(&HEADER.replace("(1, 3, 2)", shape), &ones);
    let mut long_header = b"\x93NUMPY\x02\x00".to_vec();
    long_header.extend(u32::MAX.to_le_bytes());
    let cases = [
        ("a.vol", vec![], "truncated"),
        ("a.vol", good[..47].to_vec(), "truncated"),
        ("a.vol", good[..good.len() - 1].to_vec(), "should have 24 bytes of densities, but has 23"),
        ("a.vol", [&good[..], &[0]].concat(), "but has 25"),
        ("a.vol", changed(0, b'W'), "not a Mitsuba volume"),
        ("a.vol", changed(3, 2), "version 2"),
        ("a.vol", changed(4, 3), "encoding 3"),
        ("a.vol", changed(20, 3), "3 channels; save one density per voxel, such as the mean"),
        ("a.vol", vol([0, 3, 1], unit, &[]), "is empty"),
        ("a.vol", vol([-2, 3, -1], unit, &[1.0; 6]), "is empty"),
        ("a.vol", vol([i32::MAX; 3], unit, &[]), "more than 512 million"),
        ("a.vol", vol([1 << 16, 1 << 13, 1], unit, &[]), "should have 2147483648 bytes"),
        ("a.vol", vol([2, 3, 1], [0.0; 6], &[1.0; 6]), "first corner is not below"),
        ("a.vol", vol([1, 1, 1], unit, &[f32::NAN]), "a density of NaN"),
        ("a.vol", vol([1, 1, 1], unit, &[-1.0]), "a density of -1"),
        ("a.npy", b"\x93NUMPY".to_vec(), "truncated"),
        ("a.npy", b"PK\x03\x04".to_vec(), "not a NumPy array"),
        ("a.npy", b"\x93NUMPY\x09\x00\x00\x00".to_vec(), "version 9"),
        ("a.npy", long_header, "a header of 4294967295 bytes"),
        ("a.npy", npy(HEADER, &ones)[..60].to_vec(), "truncated"),
        ("a.npy", npy("{}", &ones), "C order"),
        ("a.npy", npy(&HEADER.replace("False", "True"), &ones), "ascontiguousarray"),
        ("a.npy", npy(&HEADER.replace("<f4", ">f4"), &ones), "little-endian"),
        ("a.npy", npy(&HEADER.replace("'<f4'", "[('a', '<f4')]"), &ones), "little-endian"),
        ("a.npy", npy(HEADER, &ones[..20]), "should have 24 bytes of densities, but has 20"),
        ("a.npy", shaped("(6,)"), "shape"),
        ("a.npy", shaped("(1, 1, 2, 3)"), "3 values per voxel; save one density per voxel, such as the mean"),
        ("a.npy", shaped("(1, 1, 2, 3, 1)"), "shape"),
        ("a.npy", shaped("(1, -3, 2)"), "shape"),
        ("a.npy", shaped("(1, 3, 2"), "shape"),
        ("a.npy", shaped("(1, 99999999999, 2)"), "shape"),
        ("a.npy", shaped("(4294967295, 4294967295, 4294967295)"), "more than 512 million"),
        ("a.npy", shaped("(0, 3, 2)"), "is empty"),
        ("a.npy", npy(HEADER, &floats(&[f32::INFINITY; 6])), "a density of inf"),
        ("a.vdb", good.clone(), "use a .vol or .npy file"),
    ];
    for (name, bytes, part) in cases {
        let message = load_bytes(name, &bytes, Some(BOUNDS).filter(|_| name == "a.npy")).expect_err(part).to_string();
        assert!(message.contains(name) && message.contains(part), "{part}: {message}");
    }
    let unplaced = load_bytes("a.npy", &npy(HEADER, &ones), None).unwrap_err().to_string();
    assert!(unplaced.contains("give the box of the grid"), "{unplaced}");
    assert!(load(Path::new("absent.vol"), None).unwrap_err().to_string().contains("check the name"));
}
