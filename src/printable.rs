//! Text from files, made harmless for a terminal. A name in a file may hold characters that a terminal obeys instead of showing.

use std::borrow::Cow;

/// Whether a terminal may obey the character instead of showing it: control characters (U+001B and U+009B start commands to the
/// terminal), separators of lines, and the characters that change the direction of text, so that it reads as another text.
pub fn is_command(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// `text` with each character of [`is_command`] replaced by its code, such as `\u009b`. Line feeds and tabs stay. Inside the
/// strings of a JSON text, the code stands for the same character, so the JSON keeps its meaning.
pub fn escaped(text: &str) -> Cow<'_, str> {
    let must_go = |c: char| is_command(c) && c != '\n' && c != '\t';
    if !text.contains(must_go) {
        return Cow::Borrowed(text);
    }
    let shown = |c: char| if must_go(c) { format!("\\u{:04x}", u32::from(c)) } else { c.into() };
    Cow::Owned(text.chars().map(shown).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_obeys_is_written_as_a_code() {
        let hostile = "a\u{1b}[2Jb\u{9b}31mc\u{202e}d\u{2066}e\rf\u{7f}";
        assert_eq!(escaped(hostile), "a\\u001b[2Jb\\u009b31mc\\u202ed\\u2066e\\u000df\\u007f");
        for harmless in ["plain\n\ttext", "Größe 名前 مصباح", ""] {
            assert!(matches!(escaped(harmless), Cow::Borrowed(text) if text == harmless));
        }
    }

    #[test]
    fn json_keeps_its_meaning() {
        let name = "lamp\u{9b}\u{202e}\u{2028}";
        let json = serde_json::json!({ "node": name }).to_string();
        let read: serde_json::Value = serde_json::from_str(&escaped(&json)).unwrap();
        assert_eq!(read["node"], name);
    }
}
