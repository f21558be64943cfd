//! Replaces texel buffers by storage buffers, for devices whose texel buffers are small.
//!
//! Vulkan guarantees only 65,536 texels per texel buffer, but 128 MiB per storage buffer. A kernel therefore has variants: an
//! array that is too large for a texel buffer is declared as `array<vec4<u32>>`, and indexed instead of fetched. The values are
//! the same.

/// Returns `text` with the arrays `names`, which are declared as `var NAME: texture_1d<u32>;`, changed to storage buffers. Line
/// numbers do not change.
pub fn as_storage(text: &str, names: &[String]) -> String {
    names.iter().fold(text.to_string(), |text, name| {
        let declared = format!("var {name}: texture_1d<u32>;");
        let text = text.replace(&declared, &format!("var<storage, read> {name}: array<vec4<u32>>;"));
        with_indices(&text, name)
    })
}

/// Replaces every `textureLoad(name, INDEX, 0)` by `name[INDEX]`.
fn with_indices(text: &str, name: &str) -> String {
    let opening = format!("textureLoad({name}, ");
    let mut parts = text.split(&opening);
    let mut out = parts.next().unwrap_or_default().to_string();
    for part in parts {
        let end = closing(part);
        let index = part[..end].strip_suffix(", 0").unwrap_or(&part[..end]);
        out.push_str(&format!("{name}[{index}]{}", part.get(end + 1..).unwrap_or_default()));
    }
    out
}

/// Position in `text` of the `)` that closes a parenthesis which was opened before `text`; the length of `text` if there is none.
fn closing(text: &str) -> usize {
    let mut open = 1;
    let at = text.find(|c| {
        open += i32::from(c == '(') - i32::from(c == ')');
        open == 0
    });
    at.unwrap_or(text.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_named_arrays_alone_become_storage_buffers() {
        let text = "var a: texture_1d<u32>;\nvar ab: texture_1d<u32>;\nlet x = textureLoad(a, (i + 1u) / f(2u), 0);\n\
                    let y = g(textureLoad(ab, textureLoad(a, 0u, 0).x, 0));\n";
        let expected = "var<storage, read> a: array<vec4<u32>>;\nvar ab: texture_1d<u32>;\nlet x = a[(i + 1u) / f(2u)];\n\
                        let y = g(textureLoad(ab, a[0u].x, 0));\n";
        assert_eq!(as_storage(text, &["a".into()]), expected);
        assert_eq!(as_storage(text, &["c".into()]), text);
        let both = as_storage(text, &["a".into(), "ab".into()]);
        assert!(!both.contains("texture") && both.contains("let y = g(ab[a[0u].x]);"), "{both}");
    }
}
