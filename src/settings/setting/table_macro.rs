//! The macros that generate a table of settings, its getters and its builder from one list.

/// Generates the struct of a table from its name in experiment files and a list of settings. Each entry is a doc comment, which is also the help text, and `field:
/// type, setting;`. A field is `None` if the user did not give the setting.
///
/// With `impl Settings for`, an entry may have a default: `field: type = |settings| default, setting;`. The macro then also
/// generates a method of [`crate::settings::Settings`] that returns the value, and a method of its builder that sets it.
macro_rules! table {
    ($(#[doc = $about:literal])+ impl Settings for $table:ident = $name:literal {
        $($(#[doc = $help:literal])+ $field:ident: $type:ty $(= $default:expr)?, $setting:expr;)+
    }) => {
        $crate::settings::setting::table! {
            $(#[doc = $about])+ $table = $name { $($(#[doc = $help])+ $field: $type, $setting;)+ }
        }

        impl $crate::settings::Settings {
            $($crate::settings::setting::value!(get $field: $type, [$($default)?], $setting, [$($help),+]);)+

            /// The values of all settings that have a default; `None` for those that the estimator does not use.
            pub(in crate::settings) fn values(&self) -> $table {
                let mut table = $table::default();
                $($crate::settings::setting::value!(fill self, table, $field, [$($default)?], $setting);)+
                table
            }
        }

        impl $crate::settings::SettingsBuilder {
            $($crate::settings::setting::value!(choose $field: $type, [$($default)?], [$($help),+]);)+
        }
    };
    ($(#[doc = $about:literal])+ $table:ident = $name:literal {
        $($(#[doc = $help:literal])+ $field:ident: $type:ty, $setting:expr;)+
    }) => {
        $(#[doc = $about])+
        #[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(remote = "Self", default, deny_unknown_fields, rename_all = "kebab-case")]
        pub struct $table {
            $($(#[doc = $help])+ pub $field: Option<$type>,)+
        }

        impl $table {
            /// The settings of this table.
            pub const SETTINGS: &[$crate::settings::setting::Setting] =
                &[$($setting.help(concat!($($help),+)).table($name)),+];

            /// Calls `visitor` with every setting.
            pub fn visit(&mut self, visitor: &mut impl $crate::settings::setting::Visitor) {
                let mut settings = $table::SETTINGS.iter();
                $(visitor.visit(settings.next().expect("each field has a setting"), &mut self.$field);)+
            }

            /// The settings that the user gave.
            pub fn given(&self) -> Vec<&'static $crate::settings::setting::Setting> {
                let mut given = $crate::settings::setting::Given::default();
                self.clone().visit(&mut given);
                given.0
            }

            /// Fails with [`crate::Error::Settings`] if a value is outside its limits. The message names the flag and the limits.
            pub fn check(&self) -> $crate::error::Result<()> {
                let mut check = $crate::settings::setting::CheckLimits(Ok(()));
                self.clone().visit(&mut check);
                check.0
            }

            /// The key whose name, or whose old name, is `key`.
            fn current_key(key: String) -> String {
                let setting = $table::SETTINGS.iter().find(|setting| setting.old_key == Some(&key));
                setting.map_or(key, |setting| setting.name.into())
            }

            /// Merges two tables: the settings of `self`, and those of `below` that `self` does not give.
            pub fn over(self, below: $table) -> $table {
                $table { $($field: self.$field.or(below.$field)),+ }
            }
        }

        // `remote = "Self"` derives inherent functions of these names; the traits add dashes and old keys.
        impl serde::Serialize for $table {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                $table::serialize(self, serializer)
            }
        }

        impl<'de> serde::Deserialize<'de> for $table {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<$table, D::Error> {
                $table::deserialize($crate::settings::keys::Dashed(deserializer, $table::current_key))
            }
        }
    };
}

/// The parts that [`table`] generates for one field with a default. Generates nothing for a field without a default.
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
pub(crate) use {table, value};
