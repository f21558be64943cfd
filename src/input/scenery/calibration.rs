//! Calibration files of OpenCV, ROS and Kalibr, in YAML or JSON.

use std::collections::HashMap;
use std::path::Path;

use yaml_rust2::parser::{Event, Parser};

use crate::error::{Error, Result};
use crate::files::{check_readable, read_error};
use crate::settings::lens::LensDistortion;

/// What a calibration says of a camera.
#[derive(Debug, PartialEq)]
pub struct Calibration {
    /// Focal lengths and principal point in pixels: fx, fy, cx, cy. The centre of the first pixel is (0, 0).
    pub matrix: [f64; 4],
    pub distortion: LensDistortion,
    /// Size of the images in pixels, if the file has it.
    pub size: Option<[u32; 2]>,
}

/// Maximum size of a file in bytes, and depth of its lists and maps.
const MAX_BYTES: u64 = 1 << 20;
const MAX_DEPTH: usize = 16;

/// Names of the same thing in files of different programs.
const MATRIX: [&str; 4] = ["camera_matrix", "cameramatrix", "k", "intrinsics"];
const COEFFICIENTS: [&str; 5] = ["distortion_coefficients", "dist_coeffs", "distcoeffs", "distortion_coeffs", "d"];

/// Reads the calibration of one camera.
pub fn read(path: &Path) -> Result<Calibration> {
    let wrong = |why: String| Error::settings(format!("{}: {why}", path.display()));
    if check_readable(path)? > MAX_BYTES {
        return Err(wrong("it is larger than 1 MiB, which no calibration is; give the file of one camera".into()));
    }
    parse(&std::fs::read_to_string(path).map_err(|e| read_error(path, e))?).map_err(wrong)
}

fn parse(text: &str) -> Result<Calibration, String> {
    // OpenCV begins its files with `%YAML:1.0`, which is no YAML.
    let text = if text.starts_with("%YAML") { text.split_once('\n').map_or("", |(_, rest)| rest) } else { text };
    let values = values(text)?;
    let find = |names: &[&str]| -> Vec<&Vec<String>> {
        values.iter().filter(|(key, _)| names.contains(&key.as_str())).map(|(_, list)| list).collect()
    };
    let [matrix, coefficients] = [&MATRIX[..], &COEFFICIENTS].map(find);
    let ([matrix], [coefficients]) = (&matrix[..], &coefficients[..]) else {
        return Err("it does not have one camera matrix (camera_matrix, K or intrinsics) and one list of distortion coefficients \
                    (distortion_coefficients, dist_coeffs or D); give a file of one camera, or use --camera-matrix and --distortion"
            .into());
    };
    let matrix = match numbers("camera matrix", matrix)?[..] {
        [fx, s, cx, a, fy, cy, b, c, d] if [s, a, b, c, d] == [0.0, 0.0, 0.0, 0.0, 1.0] => [fx, fy, cx, cy],
        [fx, fy, cx, cy] => [fx, fy, cx, cy],
        _ => {
            return Err(
                "its camera matrix is not fx, 0, cx, 0, fy, cy, 0, 0, 1; calibrate without skew, and write all nine \
                        numbers"
                    .into(),
            );
        }
    };
    let coefficients = numbers("distortion", coefficients)?;
    let word = |names: &[&str]| find(names).first().and_then(|list| list.first()).map(|word| word.to_lowercase());
    let model = word(&["distortion_model"]).unwrap_or_default();
    let is_fisheye = match model.as_str() {
        "equidistant" | "fisheye" | "kannala_brandt" => true,
        "" | "plumb_bob" | "rational_polynomial" | "radtan" => {
            word(&["fisheye_model"]).is_some_and(|word| word != "0" && word != "false")
        }
        _ => {
            return Err(format!(
                "its distortion model '{model}' is unknown; use plumb_bob, rational_polynomial or equidistant"
            ));
        }
    };
    let written = format!("{coefficients:?}");
    let distortion = match is_fisheye {
        true => LensDistortion::fisheye(&coefficients, &written),
        false => LensDistortion::rational(&coefficients, &written),
    };
    let pair = find(&["resolution"]).first().map(|&pair| pair.clone());
    let sides = [word(&["image_width"]), word(&["image_height"])].into_iter().flatten().collect();
    let size = match &pair.unwrap_or(sides)[..] {
        [] => None,
        [width, height] => {
            let side = |word: &String| word.parse::<u32>().ok().filter(|&pixels| pixels > 0);
            Some([side(width), side(height)].map(|side| side.ok_or("its image size is not two numbers of pixels")))
        }
        _ => return Err("it has a width or a height of the image alone; write both, or neither".into()),
    };
    let size = size.map(|[width, height]| Ok::<_, String>([width?, height?])).transpose()?;
    Ok(Calibration { matrix, distortion: distortion.map_err(|e| e.to_string())?, size })
}

fn numbers(what: &str, words: &[String]) -> Result<Vec<f64>, String> {
    let number = |word: &String| word.parse::<f64>().ok().filter(|x| x.is_finite());
    let all: Option<Vec<f64>> = words.iter().map(number).collect();
    all.ok_or_else(|| format!("its {what} has an entry that is not a number"))
}

/// The scalars below each key, in order. The key of a scalar is that of the innermost map that does not call it `data`, in lower case. Keys
/// of different maps are kept apart.
fn values(text: &str) -> Result<Vec<(String, Vec<String>)>, String> {
    /// A list or a map that has begun.
    struct Open {
        is_map: bool,
        /// The key whose value comes next.
        key: Option<String>,
        /// Where the scalars of a list, or of a map's `data`, belong.
        place: Option<usize>,
    }
    let mut parser = Parser::new_from_str(text);
    let (mut all, mut open): (Vec<(String, Vec<String>)>, Vec<Open>) = (vec![], vec![]);
    let mut places: HashMap<(usize, String), usize> = HashMap::new();
    let mut maps = 0;
    loop {
        let (event, _) = parser.next_token().map_err(|e| format!("it is neither YAML nor JSON: {e}"))?;
        // The place that the value which begins here belongs to.
        let mut enter = |open: &mut Vec<Open>| -> Option<usize> {
            let parent = open.last_mut()?;
            match parent.key.take().filter(|_| parent.is_map) {
                Some(key) if key == "data" => parent.place,
                Some(key) => Some(*places.entry((maps, key.clone())).or_insert_with(|| {
                    all.push((key, vec![]));
                    all.len() - 1
                })),
                None => parent.place,
            }
        };
        match event {
            Event::MappingStart(..) | Event::SequenceStart(..) => {
                if open.len() == MAX_DEPTH {
                    return Err(format!("it has lists in lists, more than {MAX_DEPTH} deep; give a calibration file"));
                }
                let (place, is_map) = (enter(&mut open), matches!(event, Event::MappingStart(..)));
                maps += usize::from(is_map);
                open.push(Open { is_map, key: None, place });
            }
            Event::MappingEnd | Event::SequenceEnd => drop(open.pop()),
            Event::Scalar(word, ..) => match open.last_mut() {
                Some(map) if map.is_map && map.key.is_none() => map.key = Some(word.to_lowercase()),
                _ => {
                    if let Some(place) = enter(&mut open) {
                        all[place].1.push(word);
                    }
                }
            },
            Event::Alias(_) => return Err("it has an alias (*), which calibrations have not; write the values".into()),
            Event::StreamEnd => return Ok(all.into_iter().filter(|(_, list)| !list.is_empty()).collect()),
            Event::Nothing | Event::StreamStart | Event::DocumentStart | Event::DocumentEnd => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Distortion;

    const OPENCV: &str = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   \
                          dt: d\n   data: [ 5.4e+02, 0., 319.5, 0., 541., 2.395e+02, 0.,\n       0., 1. ]\ndistortion_coefficients: \
                          !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ -0.28, 0.09, 1e-3, -2e-3, 0. ]\n";

    fn rational(radial: [f64; 6], tangential: [f64; 2]) -> LensDistortion {
        LensDistortion(Distortion::Rational { radial, tangential })
    }

    #[test]
    fn files_of_opencv_ros_and_kalibr_are_read() {
        let expected = Calibration {
            matrix: [540.0, 541.0, 319.5, 239.5],
            distortion: rational([-0.28, 0.09, 0.0, 0.0, 0.0, 0.0], [1e-3, -2e-3]),
            size: Some([640, 480]),
        };
        assert_eq!(parse(OPENCV).unwrap(), expected);
        let json = r#"{"image_width": 640, "image_height": 480, "camera_matrix": {"type_id": "opencv-matrix", "rows": 3, "cols": 3,
            "dt": "d", "data": [540.0, 0, 319.5, 0, 541.0, 239.5, 0, 0, 1.0]}, "distortion_coefficients":
            {"type_id": "opencv-matrix", "rows": 1, "cols": 5, "dt": "d", "data": [-0.28, 0.09, 0.001, -0.002, 0.0]}}"#;
        assert_eq!(parse(json).unwrap(), expected);
        let ros = "image_width: 640\nimage_height: 480\ncamera_name: front\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [540, 0, 319.5, \
                   0, 541, 239.5, 0, 0, 1]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.28, \
                   0.09, 0.001, -0.002, 0]\nprojection_matrix:\n  rows: 3\n  cols: 4\n  data: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]\n";
        assert_eq!(parse(ros).unwrap(), expected);
        let kalibr = "cam0:\n  camera_model: pinhole\n  intrinsics: [540, 541, 319.5, 239.5]\n  distortion_model: equidistant\n  \
                      distortion_coeffs: [0.1, 0.2, 0.3, 0.4]\n  resolution: [640, 480]\n";
        let fisheye = LensDistortion(Distortion::Fisheye([0.1, 0.2, 0.3, 0.4]));
        assert_eq!(parse(kalibr).unwrap(), Calibration { distortion: fisheye, ..expected });
        let rows = "K: [[540, 0, 319.5], [0, 541, 239.5], [0, 0, 1]]\nD: [-0.28, 0.09, 0.001, -0.002]\n";
        assert_eq!(parse(rows).unwrap().matrix, [540.0, 541.0, 319.5, 239.5]);
        assert_eq!(parse(rows).unwrap().size, None);
    }

    #[test]
    fn other_files_are_refused_with_a_sentence() {
        let with = |from: &str, to: &str| parse(&OPENCV.replace(from, to)).unwrap_err();
        assert!(parse("").unwrap_err().contains("does not have one camera matrix"));
        assert!(parse("a: [1").unwrap_err().contains("neither YAML nor JSON"));
        assert!(parse(&"- ".repeat(1000)).unwrap_err().contains("more than 16 deep"));
        assert!(parse(&"[".repeat(100_000)).is_err());
        assert!(parse(&format!("{OPENCV}{}", "second:\n  K: [1, 1, 0, 0]\n")).unwrap_err().contains("one camera"));
        assert!(with("0., 319.5", "7., 319.5").contains("without skew"));
        assert!(with("-0.28", "x").contains("not a number"));
        assert!(with("image_width: 640", "image_width: -1").contains("image size"));
        assert!(with("image_width: 640\n", "").contains("alone"));
        assert!(with("image_width: 640", "distortion_model: spline").contains("'spline' is unknown"));
        assert!(parse("x: &a [1]\ny: *a\n").unwrap_err().contains("alias"));
    }
}
