//! Members of extras. Any program may use extras for any purpose, so a foreign value is not an error.

use std::fmt;

use ::gltf::json::Extras;
use serde::de::{Deserializer, IgnoredAny, MapAccess, Visitor};
use serde_json::value::RawValue;
use serde_json::{Value, json};

use super::document::Warnings;

/// The member `key` of extras. `None` if they are not an object, or if the member is missing or null. The parser would read a list as
/// an object, with members in the order of the Rust struct, so structs are not read from extras themselves.
pub fn member(extras: &Extras, key: &str) -> Option<Value> {
    let raw = serde_json::Deserializer::from_str(extras.as_ref()?.get()).deserialize_map(Member(key)).ok()??;
    // A value that the parser does not take, such as 1e999 or deeply nested lists, becomes one that no reader of a member accepts.
    Some(serde_json::from_str(raw.get()).unwrap_or_else(|_| json!([null]))).filter(|value| !value.is_null())
}

/// Warns that the member `key` of the extras of `of` is ignored, because it is not `expected`.
pub fn warn_of_foreign(key: &'static str, of: &str, expected: &str, warnings: &mut Warnings) {
    warnings.once(key, || format!("extras.{key} is ignored where it is not {expected} (first: {of})"));
}

/// Keeps the text of one member.
struct Member<'a>(&'a str);

impl<'de> Visitor<'de> for Member<'_> {
    type Value = Option<Box<RawValue>>;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let mut found = None;
        while let Some(key) = map.next_key::<String>()? {
            if key == self.0 {
                found = Some(map.next_value()?);
            } else {
                map.next_value::<IgnoredAny>()?;
            }
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_objects_have_members() {
        let of = |text: &str| member(&Some(RawValue::from_string(text.into()).unwrap()), "a");
        assert_eq!(of(r#"{"b": [1], "a": {"c": 2}}"#), Some(json!({"c": 2})));
        for other in [r#"[{"a": 1}]"#, r#"["a"]"#, r#""a""#, "3", r#"{"b": 1}"#, r#"{"a": null}"#] {
            assert_eq!(of(other), None, "{other}");
        }
        let deep = format!(r#"{{"a": {}{}}}"#, "[".repeat(1000), "]".repeat(1000));
        assert_eq!(of(&deep), Some(json!([null])));
        assert_eq!(of(r#"{"a": 1e999}"#), Some(json!([null])));
        assert_eq!(member(&None, "a"), None);
    }
}
