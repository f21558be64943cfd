//! Removes from WGSL what an entry point does not use, before naga parses it. A kernel imports whole modules and uses about half of
//! them. naga would remove the rest only after it has parsed, validated and specialised everything, at the start of every render.

use std::collections::HashMap;
use std::ops::Range;

/// `text` without the declarations that `entry` does not use. Lines keep their numbers. Returns `text` as it is if it does not declare
/// `entry`. The text has no block comments.
pub fn keep_reachable(text: &str, entry: &str) -> String {
    let declarations: Vec<Declaration> =
        declarations(text).into_iter().map(|range| Declaration::new(text, range)).collect();
    // If a name is declared twice, both declarations are kept, so that naga reports it.
    let mut by_name: HashMap<&str, Vec<usize>> = HashMap::new();
    // Whatever has no name is kept, and so is what it uses.
    let mut open = vec![];
    for (number, declaration) in declarations.iter().enumerate() {
        declaration.name.map_or(&mut open, |name| by_name.entry(name).or_default()).push(number);
    }
    let Some(entries) = by_name.get(entry) else { return text.into() };
    open.extend(entries);
    let mut is_kept = vec![false; declarations.len()];
    while let Some(number) = open.pop() {
        if !std::mem::replace(&mut is_kept[number], true) {
            open.extend(declarations[number].words.iter().filter_map(|word| by_name.get(word)).flatten());
        }
    }
    let mut kept = String::with_capacity(text.len());
    for (declaration, is_kept) in declarations.iter().zip(is_kept) {
        let source = &text[declaration.range.clone()];
        match is_kept {
            true => kept.push_str(source),
            false => kept.extend(source.chars().filter(|&letter| letter == '\n')),
        }
    }
    kept
}

/// A function, type, constant, override or variable of a module, together with the comments before it.
struct Declaration<'a> {
    range: Range<usize>,
    /// `None` for what has no name, such as the end of a file or a `const_assert`.
    name: Option<&'a str>,
    /// All words outside of comments: names that the declaration may use, and keywords.
    words: Vec<&'a str>,
}

impl<'a> Declaration<'a> {
    fn new(text: &'a str, range: Range<usize>) -> Declaration<'a> {
        let words: Vec<&str> = text[range.clone()].lines().flat_map(words).collect();
        // The name follows the keyword. In front of the name of a variable, there may be an address space and an access mode.
        let keyword =
            words.iter().position(|word| matches!(*word, "fn" | "struct" | "const" | "override" | "alias" | "var"));
        let name = keyword.and_then(|at| {
            let is_name = |word: &&&str| words[at] != "var" || !BETWEEN_ANGLES.contains(word);
            words[at + 1..].iter().find(is_name).copied()
        });
        Declaration { range, name, words }
    }
}

/// The words that may stand between `var<` and `>`. No variable has such a name.
const BETWEEN_ANGLES: [&str; 8] =
    ["storage", "uniform", "workgroup", "private", "immediate", "read", "write", "read_write"];

/// The words of a line, without its comment.
fn words(line: &str) -> impl Iterator<Item = &str> {
    let code = line.split("//").next().unwrap_or_default();
    code.split(|letter: char| !letter.is_alphanumeric() && letter != '_').filter(|word| !word.is_empty())
}

/// Divides `text` after each declaration. The last range is what follows the last declaration.
fn declarations(text: &str) -> Vec<Range<usize>> {
    let (mut ranges, mut begin, mut depth, mut is_comment) = (vec![], 0, 0, false);
    for (at, byte) in text.bytes().enumerate() {
        match byte {
            b'\n' => is_comment = false,
            b'/' => is_comment |= text.as_bytes().get(at + 1) == Some(&b'/'),
            _ if is_comment => {}
            b'{' => depth += 1,
            b'}' => depth -= 1,
            _ => {}
        }
        if !is_comment && depth == 0 && matches!(byte, b'}' | b';') {
            ranges.push(begin..at + 1);
            begin = at + 1;
        }
    }
    ranges.push(begin..text.len());
    ranges
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "// unused { ;\nconst A = 1.0;\n\
        struct S { a: f32 }\n\
        @group(0) @binding(0) var<storage, read_write> data: array<S>;\n\
        override SIZE: u32 = 4;\n\
        // calls f\nfn g() -> f32 { return A; }\n\
        fn f(s: S) -> f32 {\n    if (s.a > 0.0) { return 1.0; } // A\n    return s.a;\n}\n\
        @compute @workgroup_size(SIZE)\nfn first() { data[0].a = f(data[1]); }\n\
        @compute @workgroup_size(1)\nfn second() { data[0].a = g(); }\n";

    #[test]
    fn an_entry_point_keeps_what_it_uses() {
        let first = keep_reachable(TEXT, "first");
        for part in ["struct S", "data: array", "override SIZE", "fn f(", "return 1.0", "fn first"] {
            assert!(first.contains(part), "{part} is missing in {first}");
        }
        for part in ["const A", "fn g", "fn second", "unused"] {
            assert!(!first.contains(part), "{part} is left in {first}");
        }
        let second = keep_reachable(TEXT, "second");
        assert!(second.contains("const A") && second.contains("fn g") && !second.contains("fn f"), "{second}");
    }

    #[test]
    fn lines_keep_their_numbers() {
        let first = keep_reachable(TEXT, "first");
        assert_eq!(first.lines().count(), TEXT.lines().count());
        for (line, whole) in first.lines().zip(TEXT.lines()) {
            assert!(line.is_empty() || line == whole, "{line:?} is not {whole:?}");
        }
    }

    #[test]
    fn a_text_without_the_entry_point_stays() {
        assert_eq!(keep_reachable(TEXT, "third"), TEXT);
    }

    #[test]
    fn what_has_no_name_or_one_name_twice_stays() {
        let text = format!("const_assert A > 0.0;\n// }} {{\nfn read() {{ {{ f(); }} }}\n{TEXT}const A = 2.0;\n");
        let first = keep_reachable(&text, "first");
        assert!(first.contains("const_assert") && first.matches("const A").count() == 2, "{first}");
        assert!(!first.contains("fn read"), "{first}");
        assert!(keep_reachable(&text, "read").contains("fn read() { { f(); } }"));
    }

    #[test]
    fn sources_have_no_block_comments() {
        for (path, source) in crate::wgsl::SOURCES {
            assert!(!source.contains("/*"), "shaders/{path}.wgsl has a block comment; use //");
        }
    }
}
