use std::f64::consts::PI;

use super::*;
use crate::input::experiment::Experiment;

fn parse(keys: &str) -> Result<Scan, String> {
    let experiment = Experiment::parse(&format!("[scan]\n{keys}")).map_err(|e| e.to_string())?;
    assert_eq!(Experiment::parse(&experiment.to_toml()).unwrap(), experiment, "{}", experiment.to_toml());
    experiment.scan.unwrap().scan()
}

/// The message about an unknown key lists all keys of the table.
#[test]
fn keys_are_those_of_the_table_without_the_power() {
    let message = parse("no-such-key = 1").unwrap_err();
    let (_, keys) = message.split_once("choose one of ").unwrap();
    assert_eq!(keys.split(", ").filter(|key| *key != "power").collect::<Vec<_>>(), KEYS);
}

#[test]
fn scans_with_other_seeds_share_no_render() {
    assert_eq!([Scan::seed(7, 0), Scan::seed(8, 0)], [7, 8]);
    let mut seeds: Vec<u32> = (0..20).flat_map(|seed| (0..500).map(move |index| Scan::seed(seed, index))).collect();
    seeds.sort_unstable();
    seeds.dedup();
    assert_eq!(seeds.len(), 20 * 500);
}

#[test]
fn a_grid_has_its_points_row_by_row() {
    let scan = parse(
        "laser = [0, 0, 5]\nsensor = '0,0,4'\npoints = {corner = [-1, 1, 0], across = [2, 0, 0], down = [0, -2, 0], count = [2, 1]}",
    )
    .unwrap();
    assert_eq!(scan.laser_points, [DVec3::new(-0.5, 0.0, 0.0), DVec3::new(0.5, 0.0, 0.0)]);
    assert_eq!((scan.sensor_points.clone(), scan.sensor_count()), (None, 1));
    let camera = scan.camera(1);
    let aims = camera.projection.aims().unwrap();
    assert_eq!((aims.len(), aims[0].point), (1, DVec3::new(0.5, 0.0, 0.0)));
    assert_eq!(aims[0].uncounted, 25.25f64.sqrt() + 16.25f64.sqrt());
}

#[test]
fn all_points_of_the_sensor_belong_to_each_point_of_the_laser() {
    let keys = "laser = [0, 0, 5]\npower = 2\naccount_first_and_last_bounces = true\n\
                laser_points = [[0, 0, 0], [0, 3, 0]]\nsensor-points = [[1, 0, 0], [2, 0, 0], [3, 0, 0]]";
    let scan = parse(keys).unwrap();
    assert_eq!((scan.laser_points.len(), scan.sensor_count(), scan.sensor), (2, 3, DVec3::new(0.0, 0.0, 5.0)));
    let (camera, light) = (scan.camera(1), scan.light(0));
    assert!(camera.projection.aims().unwrap().iter().all(|aim| aim.uncounted == 0.0));
    assert_eq!((light.direction, light.kind), (DVec3::NEG_Z, LightKind::Beam { power: [2.0; 3], radius: 0.0 }));
}

fn directions(forward: &str, azimuth: &str) -> String {
    format!("points = {{forward = {forward}, azimuth = {azimuth}, elevation = [-10, 20], count = [2, 3]}}")
}

#[test]
fn directions_run_from_the_left_and_from_the_top() {
    let keys = directions("[0, 0, -2]", "[-20, 60]");
    let scan = parse(&format!("laser = [1, 2, 3]\ndivergence = 0.2\npixel-fov = 0.1\n{keys}")).unwrap();
    assert!(scan.accounts_first_and_last && scan.laser_points.len() == 6);
    let direction = |index: usize| scan.laser_points[index] - DVec3::new(1.0, 2.0, 3.0);
    let wanted = |azimuth: f64, elevation: f64| {
        let [a, e] = [azimuth, elevation].map(f64::to_radians);
        DVec3::new(a.sin() * e.cos(), e.sin(), -a.cos() * e.cos())
    };
    for (index, azimuth, elevation) in [(0, 0.0, 15.0), (1, 40.0, 15.0), (2, 0.0, 5.0), (5, 40.0, -5.0)] {
        assert!(direction(index).distance(wanted(azimuth, elevation)) < 1e-12, "{index}");
    }
    // All of the power, 1 W, is in the cone.
    let LightKind::Spot { intensity, inner, outer } = scan.light(0).kind else { panic!("a cone is a spot light") };
    let cap = |half: f32| 4.0 * PI * (0.5 * f64::from(half)).sin().powi(2);
    // The integral of the falloff, the square of a ramp, is a third of the solid angle between the cones.
    let power = f64::from(intensity[0]) * (cap(inner) + (cap(outer) - cap(inner)) / 3.0);
    assert!((power - 1.0).abs() < 1e-6, "{power}");
}

/// The 16 rows of a LiDAR whose data sheet says "-15 to 15 degrees, every 2 degrees", and its turn that begins straight ahead.
#[test]
fn ends_are_included_or_rows_are_the_centres_of_cells() {
    let angles = |keys: &str| {
        let points = "points = {forward = [0, 0, -1], azimuth = [0, 360], elevation = [-15, 15], count = [4, 16]}";
        let scan = parse(&format!("laser = [0, 0, 0]\n{keys}\n{points}")).unwrap();
        let of = |p: &DVec3| [p.x.atan2(-p.z).rem_euclid(2.0 * PI), p.y.asin()].map(f64::to_degrees);
        scan.laser_points.iter().map(of).collect::<Vec<_>>()
    };
    let close = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
    let included = angles("ends = 'included'");
    for (row, elevation) in (0..16).zip((0..16).map(|row| 15.0 - 2.0 * f64::from(row))) {
        for (column, azimuth) in [0.0, 90.0, 180.0, 270.0].into_iter().enumerate() {
            let [a, e] = included[row * 4 + column];
            close(a, azimuth);
            close(e, elevation);
        }
    }
    for keys in ["", "ends = 'centres'"] {
        let centres = angles(keys);
        close(centres[0][1], 14.0625);
        close(centres[0][0], 45.0);
        close(centres[63][1], -14.0625);
    }
    // A part of a turn has both ends, and the points of a wall have its corners. A single row is in the middle.
    let keys = |points: &str| format!("laser = [0, 0, 5]\nends = 'included'\npoints = {points}");
    let half = "{forward = [0, 0, -1], azimuth = [0, 90], elevation = [-10, 10], count = [2, 1]}";
    let scan = parse(&keys(half)).unwrap();
    assert!(scan.laser_points[0].distance(DVec3::new(0.0, 0.0, 4.0)) < 1e-12);
    assert!(scan.laser_points[1].distance(DVec3::new(1.0, 0.0, 5.0)) < 1e-12);
    let wall = "{corner = [-1, 1, 0], across = [2, 0, 0], down = [0, -2, 0], count = [3, 2]}";
    let scan = parse(&keys(wall)).unwrap();
    assert_eq!(scan.laser_points[0], DVec3::new(-1.0, 1.0, 0.0));
    assert_eq!(scan.laser_points[5], DVec3::new(1.0, -1.0, 0.0));
    let message = parse(&keys("[[0, 0, 0]]")).unwrap_err();
    assert!(message.contains("ends is for grids and directions"), "{message}");
    assert!(parse(&keys(half).replace("included", "middle")).is_err());
}

/// The scan of an experiment file in a folder with these files.
fn read(files: &[(&str, &str)], keys: &str) -> Result<Scan, String> {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    files.iter().for_each(|(name, text)| write(name, text));
    write("scan.toml", &format!("[scan]\n{keys}"));
    Experiment::read(&folder.path().join("scan.toml")).unwrap().scan.unwrap().scan()
}

const CHANNELS: &str = "elevation,azimuth offset\n12,1.5\n-7.5,-1.5\n";
const SPINNING: &str = "laser = [1, 2, 3]\nends = 'included'\n\
                        points = {channels = 'c.csv', forward = [2, 0, 0], azimuth = [0, 360], steps = 8}";

#[test]
fn a_spinning_lidar_fires_all_channels_of_a_step_at_once() {
    let keys = format!("{SPINNING}\nduration = '80ms'");
    let scan = read(&[("c.csv", CHANNELS)], &keys).unwrap();
    assert_eq!((scan.at_once, scan.laser_points.len()), (2, 16));
    let times = scan.times.as_ref().unwrap();
    for (shot, point) in scan.laser_points.iter().enumerate() {
        let [elevation, offset] = [[12.0, 1.5], [-7.5, -1.5]][shot % 2].map(f64::to_radians);
        let azimuth = 2.0 * PI * (shot / 2) as f64 / 8.0 + offset;
        // Forward is +X, and +Z is to the right.
        let wanted = DVec3::new(azimuth.cos() * elevation.cos(), elevation.sin(), azimuth.sin() * elevation.cos());
        assert!((*point - scan.laser).distance(wanted) < 1e-12, "shot {shot}");
        assert!((times[shot] - 0.01 * (shot / 2) as f64).abs() < 1e-12);
    }
    assert!(scan.places.is_none());
}

#[test]
fn a_file_of_shots_has_their_times_and_angles() {
    let keys = "laser = [1, 2, 3]\npoints = {shots = 's.csv', forward = [0, 0, -1]}";
    let shots = "Time/s,Azimuth/deg,Elevation/deg\n0,90,0\n0,0,30\n0.02,-45,0\n";
    let scan = read(&[("s.csv", shots)], keys).unwrap();
    assert_eq!(scan.times, Some(vec![0.0, 0.0, 0.02]));
    let [a, b] = [0.75f64.sqrt(), 0.5f64.sqrt()];
    for (point, wanted) in scan.laser_points.iter().zip([[1.0, 0.0, 0.0], [0.0, 0.5, -a], [-b, 0.0, -b]]) {
        assert!((*point - scan.laser).distance(DVec3::from(wanted)) < 1e-12, "{point}");
    }
    // Times count from the begin in the trajectory.
    let poses = "5,0,0,0,0,0,0,1\n6,0,0,-10,0,0,0,1\n";
    let moving = format!("{keys}\ntrajectory = 'p.csv'\nbegin = '5.5s'");
    let scan = read(&[("s.csv", shots), ("p.csv", poses)], &moving).unwrap();
    assert_eq!(scan.times, Some(vec![5.5, 5.5, 5.52]));
    assert!(scan.places.unwrap()[2].distance(DVec3::new(1.0, 2.0, -2.2)) < 1e-12);
    for (shots, keys, part) in [
        ("0.1,0,0\n0,0,0\n", keys.to_string(), "sort the shots by time"),
        ("0,0,95\n", keys.to_string(), "shot 1 has an elevation outside"),
        ("0,0\n", keys.to_string(), "s.csv:1: '0,0' is not a row"),
        ("0,0,0\n", format!("{keys}\nduration = '1s'"), "remove duration"),
        ("0,0,0\n2,0,0\n", moving.clone(), "the shots are from 5.5 s to 7.5 s"),
    ] {
        let message = read(&[("s.csv", shots), ("p.csv", poses)], &keys).unwrap_err();
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn prisms_turn_the_beam_by_snells_law() {
    let beams = |wedges: &str, turns: &str, shots: usize| {
        let points =
            format!("{{wedges = {wedges}, index = 1.5, turns = {turns}, forward = [0, 0, -1], shots = {shots}}}");
        parse(&format!("laser = [0, 0, 0]\npoints = {points}")).map(|scan| scan.laser_points)
    };
    // One prism of 10 degrees: the deviation is asin(n sin(wedge)) - wedge, to the right, up, to the left and down.
    let wedge = 10f64.to_radians();
    let (sine, cosine) = ((1.5 * wedge.sin()).asin() - wedge).sin_cos();
    for (beam, [x, y]) in
        beams("[10, 0]", "[1, 7]", 4).unwrap().iter().zip([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    {
        assert!(beam.distance(DVec3::new(x * sine, y * sine, -cosine)) < 1e-12, "{beam}");
    }
    // Thin prisms turn the beam by (n - 1) times their wedges, whose directions add up.
    let thin = 0.2f64.to_radians();
    for (k, beam) in beams("[0.2, 0.3]", "[3, -2]", 50).unwrap().iter().enumerate() {
        let [first, second] = [3.0, -2.0].map(|turns| 2.0 * PI * turns * k as f64 / 50.0);
        let wanted = [first.cos() + 1.5 * second.cos(), first.sin() + 1.5 * second.sin()].map(|x| 0.5 * thin * x);
        assert!((beam.x - wanted[0]).hypot(beam.y - wanted[1]) < 1e-4 * thin, "shot {k}: {beam}");
    }
    for (wedges, turns, part) in [
        ("[46, 0]", "[1, 1]", "from -45 to 45 degrees"),
        ("[30, 30]", "[1, -1]", "smaller wedges"),
        ("[1, 1]", "[nan, 1]", "must be finite"),
    ] {
        let message = beams(wedges, turns, 3).unwrap_err();
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn mistakes_in_files_name_the_remedy() {
    let poses = "0,0,0,0,0,0,0,1\n0.05,0,0,-1,0,0,0,1\n";
    let moving = format!("{SPINNING}\nduration = '40ms'\ntrajectory = 'p.csv'");
    assert!(read(&[("c.csv", CHANNELS), ("p.csv", poses)], &moving).is_ok());
    for (channels, poses, keys, part) in [
        ("95,0\n", poses, moving.clone(), "elevations are from -90 to 90"),
        ("1,0\n2\n", poses, moving.clone(), "c.csv:2: '2' is not a row"),
        (CHANNELS, "0,0,0,0,0,0,0,1\n0.05,,0,-1,0,0,0,1\n", moving.clone(), "p.csv:2: "),
        (CHANNELS, poses, moving.replace("40ms", "100ms"), "add poses, or change begin"),
        (CHANNELS, poses, format!("{moving}\nbegin = '30ms'"), "the shots are from 0.03 s to 0.065 s"),
        (CHANNELS, poses, moving.replace("duration = '40ms'", ""), "add duration"),
        (CHANNELS, poses, format!("{SPINNING}\nduration = '40ms'\nbegin = '1s'"), "add trajectory, or remove begin"),
        (CHANNELS, poses, moving.replace("steps = 8", "steps = 0"), "0 points"),
        (CHANNELS, poses, moving.replace("360]", "400]"), "a full turn at most"),
        (CHANNELS, poses, moving.replace("[2, 0, 0]", "[0, 1, 0]"), "not vertical"),
        (
            CHANNELS,
            poses,
            "laser = [0, 0, 5]\npoints = [[0, 0, 0]]\nduration = '40ms'\ntrajectory = 'p.csv'".into(),
            "a trajectory moves a LiDAR, whose points are directions",
        ),
    ] {
        let message = read(&[("c.csv", channels), ("p.csv", poses)], &keys).unwrap_err();
        assert!(message.contains(part), "{message}");
    }
    let message = read(&[("c.csv", CHANNELS)], &moving).unwrap_err();
    assert!(message.contains("p.csv"), "{message}");
}

#[test]
fn a_square_overlaps_a_disc() {
    for (radius, half) in [(1.0, 0.5), (1.0, 0.8), (1.0, 0.95), (1.0, 3.0), (0.2, 0.2)] {
        const STEPS: i32 = 1000;
        let at = |i: i32| half * (f64::from(i) + 0.5) / f64::from(STEPS);
        let inside = (0..STEPS).flat_map(|i| (0..STEPS).map(move |j| (i, j)));
        let inside = inside.filter(|&(i, j)| at(i).hypot(at(j)) <= radius).count();
        let share = inside as f64 / f64::from(STEPS * STEPS);
        assert!((share_in_disc(radius, half) - share).abs() < 1e-3, "{radius} {half}: {share}");
    }
    assert_eq!(share_in_disc(0.1, 0.0), 1.0);
}

#[test]
fn a_scan_has_a_million_beams() {
    let turn = |rows: u32| {
        format!(
            "laser = [0, 0, 5]\npoints = {{forward = [0, 0, -1], azimuth = [0, 360], elevation = [-9, 9], count = [8192, {rows}]}}"
        )
    };
    assert_eq!(parse(&turn(128)).unwrap().laser_points.len(), 1 << 20);
    let message = parse(&turn(129)).unwrap_err();
    assert!(message.contains("a scan has 1 to 1048576"), "{message}");
    // The sensor of an exhaustive scan has an image of one row.
    let many = turn(8).replace("\npoints", "\nlaser-points = [[0, 0, 0]]\nsensor-points");
    let message = parse(&many).unwrap_err();
    assert!(message.contains("a scan has 1 to 65535"), "{message}");
}

#[test]
fn mistakes_name_the_remedy() {
    let grid =
        |count: &str| format!("points = {{corner = [0, 0, 0], across = [1, 0, 0], down = [0, 1, 0], count = {count}}}");
    let table = [
        (String::new(), "needs points"),
        ("laser_points = [[0, 0, 0]]".into(), "needs points"),
        ("points = []".into(), "0 points"),
        ("points = [[0, 0]]".into(), "points must be points, like"),
        ("points = [[0, 0, nan]]".into(), "finite"),
        ("points = [[0, 0, 5]]".into(), "in front of the wall"),
        (grid("[0, 4]"), "0 points"),
        (grid("[4000, 4000]"), "16000000 points"),
        (grid("[4]"), "points must be points, like"),
        ("points = [[0, 0, 0]]\npower = -1".into(), "above 0"),
        ("points = [[0, 0, 1e99]]".into(), "from the origin"),
        (
            "points = [[0, 0, 0], [0, 1e16, 0]]".into(),
            "the point 0e0, 1e16, 0e0 is farther than 1e15 m from the origin",
        ),
        ("points = [[0, 0, 0], [0, 9e14, 0]]".into(), "camera 'scan sensor' aims"),
        ("laser-points = [[0, 0, 0], [0, 9e14, 0]]\nsensor-points = [[0, 0, 1], [0, 8e14, 0]]".into(), "scan sensor"),
        ("point = [[0, 0, 0]]".into(), "no key point"),
        ("points = [[0, 0, 0]]\ndivergence = 100".into(), "from 0 to 90"),
        ("points = [[0, 0, 0]]\npixel_fov = -1".into(), "from 0 to 90"),
        (directions("[0, 0, -1]", "[30, -30]"), "must rise"),
        (directions("[0, 0, -1]", "[-180, 181]"), "by a full turn at most"),
        (directions("[0, 1, 0]", "[-30, 30]"), "not vertical"),
        (format!("sensor = [0, 0, 4]\n{}", directions("[0, 0, -1]", "[-30, 30]")), "in one place"),
        (
            format!("account-first-and-last-bounces = false\n{}", directions("[0, 0, -1]", "[-30, 30]")),
            "directions give no distances",
        ),
    ];
    for (keys, part) in table {
        let message = parse(&format!("laser = [0, 0, 5]\n{keys}")).expect_err(&keys);
        assert!(message.contains(part), "{keys}: {message}");
    }
}
