//! Runs the commands of README.md and docs/GUIDE.md. Needs a device.
//!
//! The words after the opening fence of a code block tell the test what to do with the block:
//!
//! * `sh`: run the commands; they must succeed.
//! * `sh fails`: run the commands; they must fail, and their message must contain the text of the next block.
//! * `sh slow`: as `sh` in long runs (`TAUGATE_LONG_TESTS`). Otherwise `taugate render` gets `--print-config`: it reads its flags and
//!   files, and renders nothing. For commands that other tests cover, or whose kernels take long to compile.
//! * `sh no-run`: nothing. For commands that take minutes, install something or need cargo. The tests check their number.
//! * `toml NAME` and `csv NAME`: write the block to the file NAME, which later commands read.
//! * `text`, `json`: nothing.
//! * `python`: nothing. `python/tests/test_docs.py` runs them.
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A fenced code block.
struct Block {
    /// The words after the opening fence.
    info: String,
    /// Line number of the opening fence, counted from 1.
    line: usize,
    text: String,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(document: &str) -> String {
    std::fs::read_to_string(root().join(document)).unwrap_or_else(|e| panic!("{document}: {e}"))
}

fn blocks(document: &str) -> Vec<Block> {
    let mut blocks = vec![];
    let mut open: Option<Block> = None;
    for (number, line) in read(document).lines().enumerate() {
        match (line.trim_start().strip_prefix("```"), open.take()) {
            (Some(_), Some(block)) => blocks.push(block),
            (Some(info), None) => {
                open = Some(Block { info: info.into(), line: number + 1, text: String::new() });
            }
            (None, Some(mut block)) => {
                block.text += line;
                block.text.push('\n');
                open = Some(block);
            }
            // Markdown shows an indented command as code, but this test would not run it.
            (None, None) => assert!(
                !line.starts_with("    taugate"),
                "{document}:{}: put this command into a block that begins with ```sh",
                number + 1
            ),
        }
    }
    assert!(open.is_none(), "{document}: the last code block has no end");
    blocks
}

/// A folder with a copy of `scenes/`, in which the commands of the documents work as in the root of the repository.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("scenes")).unwrap();
    for entry in std::fs::read_dir(root().join("scenes")).unwrap() {
        let file = entry.unwrap();
        std::fs::copy(file.path(), folder.path().join("scenes").join(file.file_name())).unwrap();
    }
    folder
}

fn shell(folder: &Path, commands: &str) -> Output {
    let program = Path::new(env!("CARGO_BIN_EXE_taugate")).parent().expect("the program is in a folder");
    let others = std::env::var_os("PATH").unwrap_or_default();
    let path =
        std::env::join_paths([PathBuf::from(program)].into_iter().chain(std::env::split_paths(&others))).unwrap();
    Command::new("sh").args(["-e", "-c", commands]).env("PATH", path).current_dir(folder).output().expect("sh starts")
}

/// Runs the commands of a document in order, in one folder. Returns the number of blocks marked `no-run`.
fn run(document: &str) -> usize {
    let here = folder();
    let mut not_run = 0;
    let mut blocks = blocks(document).into_iter();
    while let Some(Block { info, line, text }) = blocks.next() {
        let place = format!("{document}:{line}");
        match info.split(' ').collect::<Vec<_>>()[..] {
            ["sh"] | ["sh", "slow"] => {
                let is_short = info == "sh slow" && !crate::is_long();
                let flag = if is_short { "--print-config " } else { "" };
                let output = shell(here.path(), &text.replace("taugate render ", &format!("taugate render {flag}")));
                assert!(output.status.success(), "{place}: {text}{}", String::from_utf8_lossy(&output.stderr));
            }
            ["sh", "fails"] => {
                let output = shell(here.path(), &text);
                let message = String::from_utf8_lossy(&output.stderr);
                assert!(!output.status.success(), "{place}: this succeeds:\n{text}");
                let expected = blocks.next().filter(|block| block.info == "text");
                let expected = expected.unwrap_or_else(|| {
                    panic!("{place}: add a ```text block with the expected message after this block")
                });
                for part in expected.text.lines() {
                    assert!(message.contains(part), "{place}: {text}prints {message}without {part:?}");
                }
            }
            ["sh", "no-run"] => not_run += 1,
            ["toml" | "csv", name] => std::fs::write(here.path().join(name), text).unwrap(),
            ["text" | "json" | "python"] => {}
            _ => panic!("{place}: the test does not know blocks of kind '{info}'; see the top of tests/cli/guide.rs"),
        }
    }
    not_run
}

#[test]
fn the_commands_of_readme_work() {
    assert_eq!(run("README.md"), 2, "code blocks of README.md that are not run");
}

#[test]
fn the_commands_of_the_guide_work() {
    assert_eq!(run("docs/GUIDE.md"), 17, "code blocks of docs/GUIDE.md that are not run");
}

/// Whether a page has a heading to which links with this anchor lead.
fn has_heading(page: &str, anchor: &str) -> bool {
    let headings = page.lines().filter(|line| line.starts_with('#'));
    headings.map(|line| line.trim_start_matches(['#', ' ']).to_lowercase().replace(' ', "-")).any(|a| a == anchor)
}

/// Every link to a file leads to an existing file, and every link to a part of a page to one of its headings. Links to the web are not
/// followed.
#[test]
fn links_lead_somewhere() {
    let main_pages = ["README.md", "docs/GUIDE.md", "docs/PERFORMANCE.md", "docs/ACCURACY.md", "docs/ARCHITECTURE.md"];
    let other_pages = ["docs/PAPER.md", "docs/LIMITS.md", "docs/PYTHON.md", "scenes/README.md"];
    let mut documents: Vec<String> = main_pages.into_iter().chain(other_pages).map(String::from).collect();
    for page in std::fs::read_dir(root().join("docs/notebook")).unwrap() {
        documents.push(format!("docs/notebook/{}", page.unwrap().file_name().into_string().unwrap()));
    }
    for document in documents {
        let text = read(&document);
        let folder = root().join(&document).parent().unwrap().to_path_buf();
        for link in text.split("](").skip(1).map(|rest| rest.split(')').next().unwrap()) {
            let found = match link.split_once('#') {
                Some(("", anchor)) => has_heading(&text, anchor),
                Some((file, anchor)) => {
                    std::fs::read_to_string(folder.join(file)).is_ok_and(|page| has_heading(&page, anchor))
                }
                None => link.starts_with("https://") || folder.join(link).exists(),
            };
            assert!(found, "{document}: the link to {link} leads nowhere");
        }
    }
}

/// The README fits on one and a half screens; everything else belongs in the guide.
#[test]
fn readme_is_short() {
    let words = read("README.md").split_whitespace().count();
    assert!(words <= 700, "README.md has {words} words, more than 700; move some to docs/GUIDE.md");
}
