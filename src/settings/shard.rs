//! A part of a render for one of several machines.

use std::fmt;
use std::str::FromStr;

use serde::de::{Deserialize, Deserializer, Error as _};
use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::settings::setting::value_from_text;

/// Maximum number of shards of a render.
const MAX_SHARDS: u32 = 1 << 20;

/// Shard `index` of `count`: the iterations `index`, `index + count`, `index + 2 count`, and so on, of the whole render. The shards
/// of a render are disjoint, and together they are the render. An iteration does not depend on the number of samples, so shards can
/// be extended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    index: u32,
    count: u32,
}

impl Shard {
    /// The whole render.
    pub const ALL: Shard = Shard { index: 0, count: 1 };

    /// Fails unless `index` < `count`, and `count` is at most 2^20.
    pub fn new(index: u32, count: u32) -> Result<Shard> {
        match index < count && count <= MAX_SHARDS {
            true => Ok(Shard { index, count }),
            false => Err(Error::settings(format!(
                "{index}/{count} is not a shard: the shards of N are 0/N to N-1/N, and N is at most {MAX_SHARDS}"
            ))),
        }
    }

    /// Which of the shards, from 0.
    pub fn index(self) -> u32 {
        self.index
    }

    /// Number of shards, at least 1.
    pub fn count(self) -> u32 {
        self.count
    }

    /// Whether the shard is the whole render.
    pub fn is_all(self) -> bool {
        self.count == 1
    }

    /// Whether the shard has the element `number` of a list.
    pub fn has(self, number: u32) -> bool {
        number % self.count == self.index
    }
}

impl FromStr for Shard {
    type Err = Error;

    fn from_str(text: &str) -> Result<Shard> {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.trim().parse().ok()?, n.trim().parse().ok()?)));
        let (index, count) = numbers.ok_or_else(|| {
            Error::advice(format!("'{text}' is not a shard: "), "write I/N, like 0/4 for the first of four shards")
        })?;
        Shard::new(index, count)
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl Serialize for Shard {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Shard {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
    }
}

value_from_text!(Shard);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_disjoint_and_complete() {
        let shards: Vec<Shard> = (0..3).map(|i| format!("{i}/3").parse().unwrap()).collect();
        for number in 0..20 {
            assert_eq!(shards.iter().filter(|shard| shard.has(number)).count(), 1, "{number}");
        }
        assert!(Shard::ALL.is_all() && Shard::ALL.has(7) && !shards[1].is_all());
        assert_eq!(shards[2].to_string(), "2/3");
    }

    #[test]
    fn nonsense_is_refused_with_an_example() {
        for text in ["", "1", "1/", "/2", "a/2", "-1/2", "1/2/3", "1.5/2"] {
            let message = text.parse::<Shard>().unwrap_err().to_string();
            assert!(message.contains("write I/N, like 0/4"), "{text}: {message}");
        }
        for text in ["2/2", "0/0", "5/4", "0/1048577"] {
            let message = text.parse::<Shard>().unwrap_err().to_string();
            assert!(message.contains("the shards of N are 0/N to N-1/N"), "{text}: {message}");
        }
    }
}
