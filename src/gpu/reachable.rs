//! Removes from WGSL what an entry point does not use, before naga parses it. A kernel imports whole modules and uses about half of
//! them. naga would remove the rest only after it has parsed, validated and specialised everything, at the start of every render.

use std::collections::HashMap;
use std::ops::Range;

/// `text` without the declarations that `entry` does not use. Lines keep their numbers. Returns `text` as it is if it does not declare
/// `entry`. The text has no block comments.
pub fn keep_reachable(text: &str, entry: &str) -> String {
    let declarations: Vec<Declaration> =
        declarations(text).into_iter().map(|range| Declaration::new(text, range)).collect();
    let by_name: HashMap<&str, usize> =
        declarations.iter().enumerate().filter_map(|(number, declaration)| Some((declaration.name?, number))).collect();
    let Some(&first) = by_name.get(entry) else { return text.into() };
    // Whatever has no name is kept, and so is what it uses.
    let mut open: Vec<usize> = (0..declarations.len()).filter(|&number| declarations[number].name.is_none()).collect();
    open.push(first);
    let mut is_kept = vec![false; declarations.len()];
    while let Some(number) = open.pop() {
        if !std::mem::replace(&mut is_kept[number], true) {
            open.extend(declarations[number].words.iter().filter_map(|word| by_name.get(word)));
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
        // The name follows the keyword, except that the address space of a variable is between them.
        let keyword =
            words.iter().position(|word| matches!(*word, "fn" | "struct" | "const" | "override" | "alias" | "var"));
        let name = keyword.and_then(|at| words[at + 1..].iter().find(|word| !ADDRESS_SPACES.contains(word)).copied());
        Declaration { range, name, words }
    }
}

/// Words between `var<` and `>`.
const ADDRESS_SPACES: [&str; 7] = ["storage", "uniform", "workgroup", "private", "immediate", "read", "read_write"];

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
}
