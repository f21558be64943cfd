//! The rows that `taugate bench --resume` keeps.

use taugate::internals::bench::table;

use crate::{folder, taugate};

/// Times of different devices do not belong into one table.
#[test]
fn rows_of_another_device_are_ignored() {
    let here = folder();
    let suite = "time = \"30ms\"\nrepetitions = 1\nerrors = false\n[render]\nlight-paths = 100\nmax-depth = 3\n\
                 [[scene]]\nname = \"box\"\ngenerate = { name = \"cornell-box\" }\ngate = \"8m..8.5m\"\nresolution = \"8x8\"\n\
                 [[variant]]\nname = \"lcs\"\nrender = { estimator = \"lcs\" }\n";
    std::fs::write(here.path().join("s.toml"), suite).unwrap();
    let run = |more: &[&str]| {
        let output = taugate(here.path(), &[&["bench", "s.toml", "--out", "out"], more].concat());
        let [out, messages] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
        assert!(output.status.success(), "{messages}");
        (out, messages)
    };
    // --quiet prints errors only.
    assert_eq!(run(&["-q"]), (String::new(), String::new()));
    let results = here.path().join("out/results.csv");
    // The errors are NaN, so the rows are compared as text.
    let read = || format!("{:?}", table::read(&results).unwrap());
    let (rows, text) = (table::read(&results).unwrap(), read());
    let (out, messages) = run(&["--resume"]);
    assert!(out.contains("lcs") && !messages.contains("ignored") && read() == text, "{messages}");

    let mut others = rows.clone();
    for row in &mut others {
        let at = row.fingerprint.rfind('-').unwrap() + 1;
        row.fingerprint.replace_range(at.., "0123456789abcdef");
    }
    table::write(&results, &others).unwrap();
    let (_, messages) = run(&["--resume"]);
    assert!(messages.contains("by another version of the renderer, on another device"), "{messages}");
    let measured = table::read(&results).unwrap();
    assert!(measured.iter().all(|row| row.fingerprint == rows[0].fingerprint), "{measured:?}");
}
