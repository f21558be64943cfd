use std::path::Path;

use super::sources::{DECIDE, digest};
use super::*;

/// Code that does not affect an image with given settings, or whose effect the fingerprint of the settings covers.
const ELSEWHERE: [&str; 17] = [
    "app",
    "bench",
    "compare",
    "detector",
    "error",
    "error.rs",
    "files",
    "files.rs",
    "free_memory.rs",
    "generate",
    "lib.rs",
    "lidar",
    "main.rs",
    "printable.rs",
    "self_check",
    "tev",
    "threads.rs",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The digest of a source tree with the file `text` in `src/render` and the files `more`, given by name and text.
fn digits(text: &str, more: &[(&str, &str)]) -> String {
    let tree = tempfile::tempdir().unwrap();
    for folder in DECIDE {
        std::fs::create_dir_all(tree.path().join(folder)).unwrap();
    }
    for (name, text) in [&[("src/render/a.rs", text)], more].concat() {
        std::fs::write(tree.path().join(name), text).unwrap();
    }
    digest(tree.path(), "1.2.3").unwrap()
}

#[test]
fn the_digits_are_of_the_sources_as_they_are() {
    assert_eq!(RENDERER, digest(root(), env!("CARGO_PKG_VERSION")).unwrap());
    assert_eq!(RENDERER.len(), 16);
    assert_ne!(RENDERER, digest(root(), "another version").unwrap());
}

#[test]
fn every_folder_of_the_sources_either_decides_or_does_not() {
    for entry in std::fs::read_dir(root().join("src")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let decides = DECIDE.contains(&format!("src/{name}").as_str());
        assert!(
            decides != ELSEWHERE.contains(&name.as_str()),
            "src/{name} must be in DECIDE if an image depends on it, otherwise in this test's ELSEWHERE"
        );
    }
}

#[test]
fn code_counts_and_comments_do_not() {
    let text = "//! What it is.\nfn f() -> f32 {\n    1.0\n}\n";
    let one = digits(text, &[]);
    let same = [
        "fn f() -> f32 { 1.0 // Here.\n}",
        "fn f() -> f32 {\r\n\r\n  /* One /* of */ them. */ 1.0\r\n}",
        "fn f() -> f32 {\n    1.0\n}\n\n#[cfg(test)]\nmod tests {\n    fn g() {}\n}\n",
    ];
    for other in same {
        assert_eq!(digits(other, &[]), one, "{other}");
    }
    assert_eq!(digits(text, &[("src/render/tests.rs", "fn g() {}"), ("src/render/note.md", "A note.")]), one);
    assert_ne!(digits("fn f() -> f32 { 1.1 }", &[]), one);
    assert_ne!(digits("", &[("src/render/b.rs", text)]), one);
    for folder in DECIDE {
        let another = format!("{folder}/another.wgsl");
        assert_ne!(digits(text, &[(&another, "fn g() {}")]), one, "{another}");
    }
}

/// Inside a string, text that looks like a comment or white space is part of the code.
#[test]
fn strings_count_as_they_are() {
    let pairs = [
        (r#"f("a // b")"#, r#"f("a // c")"#),
        (r#"f("a \" // b")"#, r#"f("a \" // c")"#),
        (r##"f(r#"a " // b"#)"##, r##"f(r#"a " // c"#)"##),
        (r#"g('"', 1); // ""#, r#"g('"', 2); // ""#),
        (r#"f("a b")"#, r#"f("ab")"#),
        (r"g('\'', 1)", r"g('\'', 2)"),
    ];
    for (one, other) in pairs {
        assert_ne!(digits(one, &[]), digits(other, &[]), "{one}");
    }
    assert_eq!(digits(r#"g('"') // "b"#, &[]), digits(r#"g('"')"#, &[]));
}
