//! Values as a user may write them in an experiment file.

/// A value of a type that settings read. Whole numbers are numbers, too.
#[derive(serde::Deserialize)]
#[serde(untagged)]
pub enum Typed {
    Wanted(bool),
    Number(f64),
    List(Vec<f64>),
    Text(String),
}

/// Implements `Deserialize` for a setting: a list of patterns of [`Typed`] and of results. Other values fail with `$expected`.
macro_rules! typed {
    ($type:ty, $expected:literal: $($pattern:pat => $read:expr,)+) => {
        impl<'de> serde::Deserialize<'de> for $type {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let wrong = || <D::Error as serde::de::Error>::custom($expected);
                let typed = <$crate::settings::typed::Typed as serde::Deserialize>::deserialize(deserializer);
                match typed.map_err(|_| wrong())? {
                    $($pattern => $read,)+
                    _ => return Err(wrong()),
                }
                .map_err(serde::de::Error::custom)
            }
        }
    };
}
pub(crate) use typed;
