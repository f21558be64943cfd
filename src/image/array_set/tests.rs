use super::*;
use crate::image::npy_file::COUNTS;
use crate::image::npy_read::{described, read};

/// The set of a render whose values are all `value`.
fn set(path: &Path, value: f32, has_variance: bool) -> ArraySet {
    let mut set = ArraySet::new(path);
    set.add(Role::Array, &[1, 1, 3], [value; 3]).unwrap();
    if has_variance {
        set.add(Role::Variance, &[1, 1, 3], [value; 3]).unwrap();
    }
    set
}

/// A description whose gate begins at `value` metres.
fn about(value: f32) -> Value {
    let gate = serde_json::json!({ "name": "a", "gate_begin_m": value, "gate_end_m": 9.0, "weight_integral_m": 1.0 });
    serde_json::json!({ "unit": "W/(m^2 sr)", "shape": [1, 1, 3], "responses": [gate] })
}

/// What readers see: the value of the array, of the variances and of the description.
fn seen(path: &Path) -> [Option<f32>; 3] {
    let value = |path: PathBuf| path.exists().then(|| read(&path).unwrap().values[0]);
    let variance = beside(path, Role::Variance).and_then(value);
    [value(path.into()), variance, described(path, 1).map(|gates| gates[0].gate_begin_m as f32)]
}

#[test]
fn an_interruption_after_any_step_leaves_no_files_of_two_renders() {
    for [had_variance, has_variance] in [[true, true], [true, false], [false, true]] {
        let mut whole = 0;
        for steps in 0.. {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.npy");
            set(&path, 1.0, had_variance).publish(&about(1.0)).unwrap();
            let all = set(&path, 2.0, has_variance).steps(&about(2.0)).unwrap();
            let count = all.len();
            all.into_iter().take(steps).for_each(|step| step.run().unwrap());
            let found: Vec<f32> = seen(&path).into_iter().flatten().collect();
            assert!(found.iter().all(|value| *value == found[0]), "after {steps} of {count} steps: {found:?}");
            assert!(path.exists(), "an array is always there");
            whole += usize::from(description_path(&path).exists());
            if steps == count {
                assert_eq!(seen(&path), [Some(2.0), has_variance.then_some(2.0), Some(2.0)]);
                break;
            }
        }
        assert_eq!(whole, 2, "only the old set and the new one are described");
    }
}

#[test]
fn a_file_of_another_render_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [path, other] = ["a.npy", "b.npy"].map(|name| folder.path().join(name));
    for (path, value) in [(&path, 1.0), (&other, 2.0)] {
        set(path, value, true).publish(&about(value)).unwrap();
        check_files(path).unwrap();
    }
    // A set may be renamed as a whole.
    for (from, to) in [(".npy", "c.npy"), (".json", "c.json"), (".variance.npy", "c.variance.npy")] {
        std::fs::copy(folder.path().join(format!("a{from}")), folder.path().join(to)).unwrap();
    }
    assert_eq!(seen(&folder.path().join("c.npy")), [Some(1.0); 3]);
    let refused = |result: Result<()>| {
        let message = result.unwrap_err().to_string();
        assert!(message.contains("does not belong to") && message.contains("a.json"), "{message}");
    };
    std::fs::copy(variance_path(&other), variance_path(&path)).unwrap();
    assert!(read(&path).is_ok());
    refused(read(&variance_path(&path)).map(drop));
    refused(check_files(&path));
    std::fs::copy(&other, &path).unwrap();
    refused(read(&path).map(drop));
    // Without the JSON file, the array is one of another program.
    std::fs::remove_file(description_path(&path)).unwrap();
    assert_eq!(read(&path).unwrap().values, [2.0; 3]);
}

#[test]
fn files_without_a_record_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    set(&path, 1.0, true).publish(&about(1.0)).unwrap();
    std::fs::write(description_path(&path), about(3.0).to_string()).unwrap();
    check_files(&path).unwrap();
    assert_eq!(seen(&path), [Some(1.0), Some(1.0), Some(3.0)]);
}

#[test]
fn variances_of_somebody_else_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    set(&path, 1.0, false).publish(&about(1.0)).unwrap();
    std::fs::copy(&path, variance_path(&path)).unwrap();
    assert_eq!(seen(&path), [Some(1.0), None, Some(1.0)]);
}

/// Another set whose array has the name of the variances has a JSON file of its own.
#[test]
fn variances_that_another_set_replaced_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    set(&path, 1.0, true).publish(&about(1.0)).unwrap();
    set(&variance_path(&path), 2.0, false).publish(&about(2.0)).unwrap();
    assert!(read(&variance_path(&path)).unwrap_err().to_string().contains("does not belong to"));
    assert!(check_files(&path).is_err());
    // Without its JSON file, an array has no variances.
    std::fs::remove_file(description_path(&path)).unwrap();
    assert_eq!(beside(&path, Role::Variance), None);
}

#[test]
fn a_set_that_cannot_be_written_leaves_the_old_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    set(&path, 1.0, true).publish(&about(1.0)).unwrap();
    // An array fails half-way, or the JSON file has no place.
    let mut broken = set(&path, 2.0, false);
    let long = folder.path().join("a.variance.npy");
    std::fs::remove_file(&long).unwrap();
    std::fs::create_dir(&long).unwrap();
    assert!(broken.add(Role::Variance, &[1, 1, 3], [2.0; 3]).is_err());
    drop(broken);
    assert_eq!(read(&path).unwrap().values, [1.0; 3]);
    assert!(described(&path, 1).is_some());

    let other = folder.path().join("b.npy");
    std::fs::create_dir(description_path(&other)).unwrap();
    assert!(set(&other, 2.0, false).publish(&serde_json::json!({ "unit": COUNTS })).is_err());
    assert!(!other.exists());
    let names = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(names, 4, "no temporary file stays");
}
