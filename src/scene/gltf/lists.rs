//! Bounds on the lengths of the lists in the JSON.

use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, Error as _, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::Checked;

/// The maximum length of each list. A parsed element may take 700 bytes, although its text has two characters. An accessor or a
/// bufferView has a longer text, and a mesh has several of them.
const LIMITS: [(&str, usize); 15] = [
    ("nodes", 1_000_000),
    ("meshes", 1_000_000),
    ("accessors", 4_000_000),
    ("bufferViews", 4_000_000),
    ("animations", 250_000),
    ("buffers", 250_000),
    ("cameras", 250_000),
    ("extensionsRequired", 250_000),
    ("extensionsUsed", 250_000),
    ("images", 250_000),
    ("materials", 250_000),
    ("samplers", 250_000),
    ("scenes", 250_000),
    ("skins", 250_000),
    ("textures", 250_000),
];

/// So many nodes may have a text of any length. A node with less text than this many bytes is empty, but takes as much memory as
/// any other.
const FREE_NODES: usize = 250_000;
const BYTES_PER_NODE: usize = 24;

/// Fails if a list of `json` is too long. Counts the elements without memory for them. Accepts text that is not valid glTF, which
/// the parser refuses.
pub fn check(json: &[u8]) -> Checked<()> {
    let mut too_long = None;
    let _ = serde_json::Deserializer::from_slice(json)
        .deserialize_map(Root { length: json.len(), too_long: &mut too_long });
    match too_long {
        Some((list, limit)) => {
            Err(format!("has more than {limit} {list}; merge meshes and materials before exporting"))
        }
        None => Ok(()),
    }
}

/// The top level of the JSON. Sets `too_long` to the name and the limit of a list that is too long.
struct Root<'a> {
    /// Bytes of the JSON.
    length: usize,
    too_long: &'a mut Option<(&'static str, usize)>,
}

impl<'de> Visitor<'de> for Root<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            let Some(&(list, limit)) = LIMITS.iter().find(|(list, _)| *list == key) else {
                map.next_value::<IgnoredAny>()?;
                continue;
            };
            let limit = if list == "nodes" { limit.min(FREE_NODES.max(self.length / BYTES_PER_NODE)) } else { limit };
            if map.next_value_seed(Length)? > limit {
                *self.too_long = Some((list, limit));
                return Err(A::Error::custom("the list is too long"));
            }
        }
        Ok(())
    }
}

/// Counts the elements of a list. It reads all of them: the parser takes a list that is left early for a mistake in the text.
struct Length;

impl<'de> DeserializeSeed<'de> for Length {
    type Value = usize;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<usize, D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Length {
    type Value = usize;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a list")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<usize, A::Error> {
        let mut count = 0;
        while list.next_element::<IgnoredAny>()?.is_some() {
            count += 1;
        }
        Ok(count)
    }
}
