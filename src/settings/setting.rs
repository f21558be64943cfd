//! What is known about a setting, and the macro that makes a table of settings from one listing.

use std::ffi::OsStr;
use std::path::PathBuf;

use crate::error::{Error, Result};
use crate::settings::Estimator;

/// One setting: a flag of the command line, and the key of the same name in an experiment file.
#[derive(Debug, Clone, Copy)]
pub struct Setting {
    /// The key and, after two dashes, the flag.
    pub name: &'static str,
    /// The letter of the short flag.
    pub short: Option<char>,
    /// Heading of the help under which the flag stands.
    pub heading: &'static str,
    /// Stands for the value in the help.
    pub value: &'static str,
    pub help: &'static str,
    pub form: Form,
    /// The setting that says the same in another way: at most one of the two can be given.
    pub excludes: Option<&'static str>,
    /// The least and the greatest count that is accepted.
    pub limits: Option<(u32, u32)>,
    used_by: fn(Estimator) -> bool,
}

/// How a flag takes its value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// `--flag VALUE`
    Value,
    /// `--flag VALUE`, where the value may begin with a minus sign.
    Signed,
    /// `--flag VALUE`, any number of times.
    Repeated,
    /// `--flag` alone means true.
    Switch,
    /// `--flag` or `--flag VALUE`; the flag alone means `bare`. With `equals`, only `--flag=VALUE` gives a value.
    Optional { bare: &'static str, equals: bool },
}

impl Setting {
    const fn new(heading: &'static str, name: &'static str, value: &'static str) -> Setting {
        Setting {
            name,
            short: None,
            heading,
            value,
            help: "",
            form: Form::Value,
            excludes: None,
            limits: None,
            used_by: |_| true,
        }
    }

    pub const fn scene(name: &'static str, value: &'static str) -> Setting {
        Setting::new("Scene", name, value)
    }

    pub const fn gate(name: &'static str, value: &'static str) -> Setting {
        Setting::new("Gate", name, value)
    }

    pub const fn sampling(name: &'static str, value: &'static str) -> Setting {
        Setting::new("Sampling", name, value)
    }

    pub const fn output(name: &'static str, value: &'static str) -> Setting {
        Setting::new("Output", name, value)
    }

    pub const fn diagnostics(name: &'static str, value: &'static str) -> Setting {
        Setting::new("Diagnostics", name, value)
    }

    pub const fn help(self, help: &'static str) -> Setting {
        Setting { help, ..self }
    }

    pub const fn short(self, letter: char) -> Setting {
        Setting { short: Some(letter), ..self }
    }

    pub const fn form(self, form: Form) -> Setting {
        Setting { form, ..self }
    }

    pub const fn excludes(self, other: &'static str) -> Setting {
        Setting { excludes: Some(other), ..self }
    }

    pub const fn within(self, min: u32, max: u32) -> Setting {
        Setting { limits: Some((min, max)), ..self }
    }

    /// Only estimators for which `used_by` holds ask for the setting.
    pub const fn only_for(self, used_by: fn(Estimator) -> bool) -> Setting {
        Setting { used_by, ..self }
    }

    /// Whether an image of this estimator depends on the setting.
    pub fn is_used_by(&self, estimator: Estimator) -> bool {
        (self.used_by)(estimator)
    }

    /// Fails if `count` is outside the limits.
    pub fn check(&self, count: u32) -> Result<()> {
        let bounds = match self.limits {
            Some((min, max)) if !(min..=max).contains(&count) => match min {
                0 => format!("at most {max}"),
                _ => format!("from {min} to {max}"),
            },
            _ => return Ok(()),
        };
        Err(Error::Settings(format!("--{} is {count}; it must be {bounds}", self.name)))
    }

    /// What to tell a user who gave the setting to an estimator that does not use it.
    pub fn without_effect(&self, estimator: Estimator) -> Option<String> {
        if self.is_used_by(estimator) {
            return None;
        }
        let users: Vec<&str> =
            Estimator::ALL.into_iter().filter(|&e| self.is_used_by(e)).map(Estimator::name).collect();
        let users = match &users[..] {
            [one] => one.to_string(),
            [some @ .., last] => format!("{} and {last}", some.join(", ")),
            [] => "no estimator".into(),
        };
        Some(format!("--{} is for {users}; {estimator} renders as without it", self.name))
    }
}

/// A type that settings have.
pub trait Value: Clone + Send + Sync + 'static {
    /// Reads a word of the command line.
    fn parse(word: &OsStr) -> Result<Self, String>;

    /// What [`Setting::limits`] bound.
    fn count(&self) -> Option<u32> {
        None
    }

    /// The file that the value names.
    fn path(&mut self) -> Option<&mut PathBuf> {
        None
    }

    /// Two values of a [`Form::Repeated`] flag, as one.
    fn and(self, later: Self) -> Self {
        later
    }
}

/// Implements [`Value`] through `FromStr`, with further methods where some are given.
macro_rules! value_from_text {
    ($($type:ty $({ $($more:item)+ })?),+ $(,)?) => {$(
        impl $crate::settings::setting::Value for $type {
            fn parse(word: &std::ffi::OsStr) -> Result<Self, String> {
                let text = word.to_str().ok_or("this is not UTF-8")?;
                text.parse::<$type>().map_err(|e| e.to_string())
            }
            $($($more)+)?
        }
    )+};
}
pub(crate) use value_from_text;

value_from_text!(bool, String, u32 {
    fn count(&self) -> Option<u32> {
        Some(*self)
    }
});

impl Value for PathBuf {
    fn parse(word: &OsStr) -> Result<PathBuf, String> {
        Ok(word.into())
    }

    fn path(&mut self) -> Option<&mut PathBuf> {
        Some(self)
    }
}

/// Looks at every setting of a table in turn.
pub trait Visitor {
    /// `slot` holds what was typed, if anything was.
    fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>);
}

/// Makes the struct of a table from its listing: documentation, which is also the help, then `field: type, setting;`. A field is
/// `None` where nothing was typed.
///
/// With `impl Settings for`, fields that have a default, `field: type = |settings| default, setting;`, become values of
/// [`crate::settings::Settings`], chosen by methods of its builder.
macro_rules! table {
    ($(#[doc = $about:literal])+ impl Settings for $table:ident {
        $($(#[doc = $help:literal])+ $field:ident: $type:ty $(= $default:expr)?, $setting:expr;)+
    }) => {
        $crate::settings::setting::table! {
            $(#[doc = $about])+ $table { $($(#[doc = $help])+ $field: $type, $setting;)+ }
        }

        impl $crate::settings::Settings {
            $($crate::settings::setting::value!(get $field: $type, [$($default)?], $setting, [$($help),+]);)+

            /// The values of all settings that have a default and that the estimator uses.
            pub(super) fn values(&self) -> $table {
                let mut table = $table::default();
                $($crate::settings::setting::value!(fill self, table, $field, [$($default)?], $setting);)+
                table
            }
        }

        impl $crate::settings::SettingsBuilder {
            $($crate::settings::setting::value!(choose $field: $type, [$($default)?], [$($help),+]);)+
        }
    };
    ($(#[doc = $about:literal])+ $table:ident {
        $($(#[doc = $help:literal])+ $field:ident: $type:ty, $setting:expr;)+
    }) => {
        $(#[doc = $about])+
        #[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(remote = "Self", default, deny_unknown_fields, rename_all = "kebab-case")]
        pub struct $table {
            $($(#[doc = $help])+ pub $field: Option<$type>,)+
        }

        impl $table {
            /// Shows all settings to `visitor`.
            pub fn visit(&mut self, visitor: &mut impl $crate::settings::setting::Visitor) {
                $({
                    const SETTING: &$crate::settings::setting::Setting = &$setting.help(concat!($($help),+));
                    visitor.visit(SETTING, &mut self.$field);
                })+
            }

            /// This where it says something, `below` elsewhere.
            pub fn over(self, below: $table) -> $table {
                $table { $($field: self.$field.or(below.$field)),+ }
            }
        }

        impl serde::Serialize for $table {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                $table::serialize(self, serializer)
            }
        }

        impl<'de> serde::Deserialize<'de> for $table {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<$table, D::Error> {
                $table::deserialize($crate::settings::keys::Dashed(deserializer))
            }
        }
    };
}
pub(crate) use table;

/// Parts of [`table`] for one field: nothing for a field without a default.
macro_rules! value {
    (get $field:ident: $type:ty, [$default:expr], $setting:expr, [$($help:literal),+]) => {
        $(#[doc = $help])+
        pub fn $field(&self) -> $type {
            let default: fn(&$crate::settings::Settings) -> $type = $default;
            let chosen = self.chosen.render.$field.filter(|_| $setting.is_used_by(self.estimator()));
            chosen.unwrap_or_else(|| default(self))
        }
    };
    (fill $settings:ident, $table:ident, $field:ident, [$default:expr], $setting:expr) => {
        $table.$field = $setting.is_used_by($settings.estimator()).then(|| $settings.$field());
    };
    (choose $field:ident: $type:ty, [$default:expr], [$($help:literal),+]) => {
        $(#[doc = $help])+
        pub fn $field(mut self, value: impl Into<Option<$type>>) -> Self {
            self.render.$field = value.into();
            self
        }
    };
    ($($without_default:tt)*) => {};
}
pub(crate) use value;
