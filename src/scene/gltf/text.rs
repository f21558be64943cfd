//! The text of the JSON, before it is parsed.

use std::borrow::Cow;

use super::{Checked, extension};

/// Objects nested deeper than this are not looked at. The parser refuses them, unless it does not read them at all.
const MAX_DEPTH: usize = 128;
/// Whole numbers up to this one are exact in f64.
const MAX_WHOLE: f64 = (1u64 << 53) as f64;

/// What the brace or bracket around a place of the text stands for.
#[derive(Clone, Copy, PartialEq)]
enum Around {
    Object,
    List,
    /// The object `extensions`; its members are extensions.
    Extensions,
}

/// `json`, in which whole numbers with a fraction or an exponent, such as 4.0, are written as integers: some exporters write counts and
/// indices so, but the parser wants integers. Fails if an extension that taugate reads is a list: the parser would read the elements as the members of
/// an object. Text that is not valid JSON stays so.
pub fn normalised(json: &[u8]) -> Checked<Cow<'_, [u8]>> {
    let (mut out, mut copied) = (vec![], 0);
    let mut around: Vec<Around> = vec![];
    // Number of braces and brackets that are open inside of extras, or deeper than MAX_DEPTH.
    let mut skipped = 0usize;
    let (mut key, mut string): (&[u8], &[u8]) = (b"", b"");
    let mut at = 0;
    while let Some(&byte) = json.get(at) {
        let mut length = 1;
        match byte {
            b'"' => {
                let end = end_of_string(json, at + 1);
                string = &json[at + 1..end];
                length = end + 1 - at;
            }
            b':' => key = string,
            b',' => key = b"",
            b'{' | b'[' => {
                let outer = around.last().copied();
                if outer == Some(Around::Extensions) && byte == b'[' && skipped == 0 && extension::is_read(key) {
                    let name = String::from_utf8_lossy(key);
                    return Err(format!(
                        "has a list instead of an object for the extension {name}; re-export the file"
                    ));
                }
                let is_extras = outer == Some(Around::Object) && key == b"extras";
                if skipped > 0 || is_extras || around.len() >= MAX_DEPTH {
                    skipped += 1;
                } else if byte == b'[' {
                    around.push(Around::List);
                } else if outer == Some(Around::Object) && key == b"extensions" {
                    around.push(Around::Extensions);
                } else {
                    around.push(Around::Object);
                }
                key = b"";
            }
            b'}' | b']' => {
                if skipped > 0 {
                    skipped -= 1;
                } else {
                    around.pop();
                }
                key = b"";
            }
            b'-' | b'0'..=b'9' => {
                let token = number(&json[at..]);
                length = token.len();
                if let Some(whole) = as_integer(token) {
                    out.extend_from_slice(&json[copied..at]);
                    out.extend_from_slice(whole.as_bytes());
                    copied = at + length;
                }
            }
            _ => {}
        }
        at += length;
    }
    if copied == 0 {
        return Ok(Cow::Borrowed(json));
    }
    out.extend_from_slice(&json[copied..]);
    Ok(Cow::Owned(out))
}

/// Index of the quotation mark that ends the string whose first character is at `from`; the end of the text if there is none.
fn end_of_string(json: &[u8], mut from: usize) -> usize {
    loop {
        match json.get(from..).and_then(|rest| rest.iter().position(|byte| matches!(byte, b'"' | b'\\'))) {
            Some(place) if json[from + place] == b'"' => return from + place,
            Some(place) => from += place + 2,
            None => return json.len(),
        }
    }
}

/// The number at the beginning of `text`.
fn number(text: &[u8]) -> &[u8] {
    let is_part = |byte: &u8| matches!(byte, b'0'..=b'9' | b'+' | b'-' | b'.' | b'e' | b'E');
    &text[..text.iter().position(|byte| !is_part(byte)).unwrap_or(text.len())]
}

/// The number without its fraction and exponent; `None` if it has neither, or if it is not whole.
fn as_integer(number: &[u8]) -> Option<String> {
    let point = number.iter().position(|byte| matches!(byte, b'.' | b'e' | b'E'))?;
    // Most numbers have a fraction. They need not be parsed.
    let has_exponent = number[point..].iter().any(|byte| matches!(byte, b'e' | b'E'));
    if !has_exponent && number[point + 1..].iter().any(|byte| *byte != b'0') {
        return None;
    }
    let value: f64 = std::str::from_utf8(number).ok()?.parse().ok()?;
    (value.fract() == 0.0 && value.abs() <= MAX_WHOLE).then(|| format!("{value:.0}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> String {
        String::from_utf8(normalised(text.as_bytes()).unwrap().into_owned()).unwrap()
    }

    #[test]
    fn whole_numbers_become_integers() {
        assert_eq!(of(r#"{"a": [4.0, -2.00, 1e3, 2.5E1,7], "b":0.5}"#), r#"{"a": [4, -2, 1000, 25,7], "b":0.5}"#);
        for same in [r#"{"a 4.0 \" 4.0": "4.0"}"#, "[0.25, 1e-3, 1e300, -1.5, 1e999]", "\"4.0", "[4", "[4.0.0]"] {
            assert_eq!(of(same), same);
            assert!(matches!(normalised(same.as_bytes()), Ok(Cow::Borrowed(_))));
        }
        // Their values as floats stay the same, -0 included.
        for text in ["-0.0", "16777217.0", "9007199254740992.0", "3e10"] {
            let [before, after] = [text, &of(text)].map(|text| serde_json::from_str::<f32>(text).unwrap().to_bits());
            assert_eq!(before, after, "{text}");
        }
    }

    #[test]
    fn extensions_are_objects_outside_of_extras() {
        for wrong in [
            r#"{"extensions": {"KHR_materials_ior": [1]}}"#,
            r#"{"nodes": [{"extensions": {"a": {}, "KHR_materials_ior": []}}]}"#,
        ] {
            let message = normalised(wrong.as_bytes()).unwrap_err();
            assert!(message.contains("for the extension KHR_materials_ior; re-export"), "{wrong}: {message}");
        }
        for right in [
            r#"{"extensions": {"KHR_materials_ior": {"list": [[1]]}, "X_y": [1]}, "extensionsUsed": ["X_y"]}"#,
            r#"{"extras": {"extensions": {"KHR_materials_ior": [1]}}}"#,
            r#"{"nodes": [{"extras": [{"extensions": {"KHR_materials_ior": [1]}}]}]}"#,
        ] {
            assert_eq!(of(right), right);
        }
        let deep = "[".repeat(1 << 20) + "4.0";
        assert_eq!(of(&deep).len(), (1 << 20) + 1);
    }
}
